"""State taken over by another graph of objects: small graphs, of which every rule can be seen."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import pytest

from lgmpc.config.takeover import Beginning, take_over
from lgmpc.errors import InputError


@dataclass(frozen=True)
class Shape:
    """A value with a name that follows from the settings."""

    name: str


class Filter:
    """Averages: a gain that is a setting and a memory that is state, in one array."""

    def __init__(self, gain: float, size: int = 2) -> None:
        self.table = np.array([gain, *np.zeros(size)])
        self.queue: deque[float] = deque()
        self.rng = np.random.default_rng(7)
        self.count = 0
        self.lazy: Any = None

    @cached_property
    def doubled(self) -> float:
        return 2.0 * float(self.table[0])

    def reset(self) -> None:
        self.count = 0

    def update(self, value: float) -> float:
        if self.lazy is None:
            self.lazy = {"first": value}
        self.queue.append(value)
        self.count += 1
        self.table[1] += self.table[0] * value + self.rng.normal() + self.doubled
        return float(self.table[1])


@dataclass
class Machine:
    """Two objects that share one, a choice among shapes, and a closure over the filter."""

    gain: float
    size: int = 2
    shapes: dict[str, Shape] = field(init=False)
    chosen: Shape = field(init=False)
    filter: Filter = field(init=False)
    same: list[Filter] = field(init=False)

    def __post_init__(self) -> None:
        self.shapes = {name: Shape(f"{name} {self.gain}") for name in ("round", "square")}
        self.chosen = self.shapes["round"]
        self.filter = Filter(self.gain, self.size)
        self.same = [self.filter]
        inner = self.filter
        self.step = lambda value: inner.update(value)
        self.held = -0.0


def ran(gain: float, size: int = 2) -> tuple[Machine, Beginning]:
    machine = Machine(gain, size)
    beginning = Beginning(machine)
    for value in (1.0, 2.0, 3.0):
        machine.step(value)
    machine.chosen = machine.shapes["square"]
    machine.held = 0.0
    return machine, beginning


def test_with_equal_settings_the_other_graph_continues_bit_for_bit() -> None:
    (first, _), (_, beginning) = ran(0.1), ran(0.1)
    new = Machine(0.1)
    assert take_over(beginning, new) == ()
    assert [new.step(4.0), new.step(5.0)] == [first.step(4.0), first.step(5.0)]
    assert new.filter.queue == first.filter.queue and new.filter.lazy == first.filter.lazy
    assert np.signbit(new.held) == np.signbit(first.held) and not np.signbit(new.held)


def test_settings_are_those_of_the_new_graph_also_within_an_array_that_has_state() -> None:
    old, beginning = ran(0.1)
    memory = float(old.filter.table[1])
    new = Machine(0.5)
    take_over(beginning, new)
    np.testing.assert_array_equal(new.filter.table, [0.5, memory, 0.0])
    assert new.filter.doubled == 1.0  # derived from the setting, not taken over


def test_references_lead_to_the_new_graphs_objects() -> None:
    _, beginning = ran(0.1)
    new = Machine(0.5)
    take_over(beginning, new)
    assert new.chosen is new.shapes["square"] and new.chosen.name == "square 0.5"
    assert new.same[0] is new.filter


def test_random_numbers_go_on_or_begin_anew() -> None:
    draws = []
    for go_on in (True, False):
        _, beginning = ran(0.1)
        new = Machine(0.1)
        take_over(beginning, new, draws=go_on)
        draws.append(float(new.filter.rng.normal()))
    rng = np.random.default_rng(7)
    numbers = rng.normal(size=4)
    assert draws == [numbers[3], numbers[0]]


def test_what_has_another_structure_begins_anew_and_is_reported() -> None:
    _, beginning = ran(0.1, size=2)
    new = Machine(0.1, size=5)
    assert take_over(beginning, new) == ("filter",)
    assert new.filter.count == 0 and new.filter.table.shape == (6,)
    assert new.chosen is new.shapes["square"]  # the rest is taken over


def test_another_structure_where_nothing_can_begin_anew_is_refused() -> None:
    old = {"memory": np.zeros(2)}
    beginning = Beginning(old)
    old["memory"][0] = 1.0
    with pytest.raises(InputError, match=r"memory: got shape \(3,\); expected the structure .*, shape \(2,\)"):
        take_over(beginning, {"memory": np.zeros(3)})


def test_another_structure_of_what_the_run_left_alone_is_no_matter() -> None:
    beginning = Beginning({"pushes": [1.0, 2.0], "table": np.zeros(2)})
    new = {"pushes": [3.0], "table": np.zeros(3)}
    assert take_over(beginning, new) == ()
    assert new["pushes"] == [3.0]
