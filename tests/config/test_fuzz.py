"""Any damage to a shipped config ends in a config that can be checked, or in an error of lgmpc: never in a crash."""

from __future__ import annotations

import copy
import os
import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from lgmpc.cli.inspecting import show_checked
from lgmpc.config import parse_any_config
from lgmpc.config.yaml_text import parse_yaml, write_yaml
from lgmpc.errors import LgmpcError

VALUES: tuple[Any, ...] = (
    None,
    True,
    False,
    0,
    -1,
    1,
    7,
    10**30,
    -0.0,
    1e-300,
    1e-9,
    0.5,
    -2.5,
    1e9,
    1e300,
    float("inf"),
    float("-inf"),
    float("nan"),
    "",
    "abc",
    "*",
    "[",
    "1e3",
    "solo12",
    "../..",
    "\u00fc\U0001f9be",
    "x" * 5000,
    [],
    [[]],
    [1, "a", None],
    [0.0, 1.0],
    [1.0, 0.0, 0.0],
    [float("nan")] * 3,
    {},
    {"": 1},
    {"a": {"b": {"c": []}}},
    {"*": 1.0},
    {"*_KFE": -1},
    {"kind": "stand"},
    {"kind": "nothing"},
    {"model": "full_body"},
)
"""What a value becomes: another type, an extreme number, text, an empty or nested container."""


def places(data: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Paths of everything in ``data``, itself excluded."""
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in items:
        yield (*path, key)
        yield from places(value, (*path, key))


def mutate(data: Any, rng: random.Random) -> Any:
    """Return a copy with one to three changes: a value scaled, replaced, removed, renamed, added, or copied."""
    data = copy.deepcopy(data)
    for _ in range(rng.randint(1, 3)):
        everything = list(places(data))
        if not everything:
            break
        *outer, key = rng.choice(everything)
        around = data
        for part in outer:
            around = around[part]
        change, value = rng.randrange(10), around[key]
        if change < 4 and isinstance(value, (int, float)) and not isinstance(value, bool):
            around[key] = type(value)(value * rng.choice((-1, 0, 2, 10, 1000, 0.5, 0.1, 1e-3, 1e-6, 1e6)))
        elif change < 6:
            around[key] = copy.deepcopy(rng.choice(VALUES))
        elif change == 6:
            del around[key]
        elif isinstance(around, dict) and change == 7:
            around[f"{key}{rng.choice('xs_1')}"] = around.pop(key)
        elif isinstance(around, dict) and change == 8:
            around[rng.choice(("kind", "model", "nodes", "unknown", "gate"))] = copy.deepcopy(rng.choice(VALUES))
        else:
            *elsewhere, last = rng.choice(everything)
            other = data
            for part in elsewhere:
                other = other[part]
            around[key] = copy.deepcopy(other[last])
    return data


def check(text: str, path: Path) -> None:
    """Do what ``lgmpc check`` does; refusals are an LgmpcError with exit code 2."""
    try:
        show_checked(parse_any_config(text, name=path.name, folder=path.parent))
    except LgmpcError as error:
        assert error.exit_code == 2
        assert str(error)


def fuzz(path: Path, count: int) -> None:
    data, _ = parse_yaml(path.read_text(encoding="utf-8"), path.name)
    for seed in range(count):
        text = write_yaml(mutate(data, random.Random(f"{path.stem} {seed}")))
        try:
            check(text, path)
        except Exception as error:
            raise AssertionError(f"seed {seed} of {path.name}:\n{text}") from error


def test_damaged_configs_are_refused_or_checked(shipped: Path) -> None:
    fuzz(shipped, 10)


@pytest.mark.slow
def test_many_damaged_configs_are_refused_or_checked(shipped: Path) -> None:
    """Of each config; ``LGMPC_FUZZ=150`` makes it 11,000 of all together."""
    fuzz(shipped, int(os.environ.get("LGMPC_FUZZ", "25")))
