"""Ablation: the effect of each part of a controller, by a sweep with each of them off or neutral, in pairs."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lgmpc.config.loading import load_config, parse_assignment
from lgmpc.config.schema import Config
from lgmpc.config.yaml_text import write_yaml
from lgmpc.errors import InputError
from lgmpc.runs.figures import figure_of
from lgmpc.shipped import config_file
from lgmpc.sweeps.comparison import Quantity, judged
from lgmpc.sweeps.design import Sweep, parse_sweep, value_at
from lgmpc.sweeps.rows import Estimate, Row, paired, place, share

__all__ = ["COMPLETE", "PARTS", "Part", "Worth", "ablation_sweep", "parts_of", "worths"]

COMPLETE = "complete"
"""Name of the variant with all parts."""


@dataclass(frozen=True)
class Part:
    """A part that can be removed.

    Attributes:
        key: key of the config.
        neutral: value at which it has no effect.
        words: description.
    """

    key: str
    neutral: Any
    words: str = ""

    @property
    def name(self) -> str:
        """Name of the variant without it."""
        return f"{self.key}={json.dumps(self.neutral)}"


PARTS = (
    Part("mpc.enabled", False, "model-predictive control"),
    Part("mpc.wrench_decay_s", 1e-3, "prediction of the observed wrench"),
    Part("mpc.uprighting_rate_hz", 0.0, "angular momentum that rights the base"),
    Part("mpc.weights.angular_momentum", 0.0, "angular momentum in the plan"),
    Part("wbc.joint_horizon_s", 1e-4, "look-ahead of the joint limits"),
    Part("wbc.weights.angular_momentum", 0.0, "task of the angular momentum"),
    Part("wbc.weights.base_orientation", 0.0, "task of the base's orientation"),
    Part("wbc.weights.posture", 0.0, "task of the posture"),
    Part("wbc.gains.stance_damping", 0.0, "damping of sliding feet"),
    Part("locomotion.footholds.feedback", 0.0, "velocity feedback of the footholds"),
    Part("locomotion.footholds.centrifugal", 0.0, "outward shift of the footholds in turns"),
    Part("locomotion.contacts.ramp_s", 0.0, "ramp of the forces after touchdown"),
    Part("locomotion.reaction.enabled", False, "steps against pushes"),
)
"""Parts that are removed if none is named, as far as a config has them."""


@dataclass(frozen=True)
class Worth:
    """The effect of removing a part.

    Attributes:
        part: the part.
        passed: share of the points that pass without it.
        lost: share of the pairs that pass only with the part, minus the share that pass only without it.
        changes: means over the pairs, with the part and without it, of the metrics of control; those that the gate
            limits first, each group by decreasing worsening.
    """

    part: Part
    passed: Estimate
    lost: float
    changes: tuple[Quantity, ...]


def parts_of(config: Config, wanted: Sequence[str]) -> tuple[Part, ...]:
    """Return the parts to remove.

    Args:
        config: config of the complete controller.
        wanted: keys, each at its neutral value (a switch off, a table with a switch off, a number 0), or
            ``key=value``; all of :data:`PARTS` that have an effect in the config if empty.

    Raises:
        InputError: a key does not exist, has no neutral value that the config accepts, or has its neutral value.
    """
    if wanted:
        return tuple(_part(config, text) for text in wanted)
    walks = bool(config.commands) or config.locomotion.reaction.enabled
    found = []
    for part in PARTS:
        if walks or not part.key.startswith("locomotion"):
            with suppress(InputError):  # the model of this config has no such part
                found += [part] if _changes(config, part) else []
    return tuple(found)


def _part(config: Config, text: str) -> Part:
    key, given, _ = text.partition("=")
    key, neutral = parse_assignment(text) if given else _neutral(config, key)
    part = Part(key, neutral, next((each.words for each in PARTS if each.key == key), ""))
    try:
        changed = _changes(config, part)
    except InputError as error:
        if given or error.argument != part.key:
            raise
        expected = f"a value at which it has no effect: {text}=VALUE (0 is refused: {error.expected})"
        raise InputError(text, "no value", expected, error.choices) from error
    if not changed:
        raise InputError(part.key, f"{part.neutral}, which it is already", "a part that the config uses, or KEY=VALUE")
    return part


def _neutral(config: Config, key: str) -> tuple[str, Any]:
    """Return key and neutral value of a part: that of :data:`PARTS`, or the one that its kind suggests."""
    for part in PARTS:
        if key in (part.key, part.key.removesuffix(".enabled")):
            return part.key, part.neutral
    present = value_at(config, key)
    if isinstance(present, Mapping):
        if "enabled" in present:
            return f"{key}.enabled", False
        inner = [f"{key}.{each}" for each in present]
        raise InputError(key, "a table", "one value of it, or a table that can be switched off", inner)
    if isinstance(present, (bool, int, float)):
        return key, type(present)(0)
    if isinstance(present, (list, tuple)) and all(isinstance(each, (int, float)) for each in present):
        return key, [0.0] * len(present)
    raise InputError(key, present, "a switch, a number or a vector, or a value without effect: KEY=VALUE")


def _changes(config: Config, part: Part) -> bool:
    """Return whether a part has another value than its neutral one."""
    return config.replace({part.key: part.neutral}).model_dump(exclude={"name"}) != config.model_dump(exclude={"name"})


def ablation_sweep(
    config: str | Path, wanted: Sequence[str], overrides: Sequence[str] = (), *, seeds: int = 1
) -> tuple[Sweep, tuple[Part, ...]]:
    """Return the sweep that compares a controller with itself without each part, and the parts.

    Args:
        config: a config's file or the name of a shipped one.
        wanted: see :func:`parts_of`.
        overrides: changes ``key=value`` of the config.
        seeds: number of seeds, from the config's own on.

    Raises:
        ConfigError: the config cannot be read or used.
        InputError: a part cannot be removed, the config has none, or ``seeds`` is below 1.
    """
    if seeds < 1:
        raise InputError("seeds", seeds, "at least 1")
    loaded = load_config(config, list(overrides))
    parts = parts_of(loaded, wanted)
    if not parts:
        raise InputError("KEY", "none, and the config has none of the usual parts", "keys of parts to remove")
    document: dict[str, Any] = {
        "name": "ablation-" + re.sub(r"[^A-Za-z0-9._-]+", "-", loaded.name)[:60],
        "base": str(config_file(config).resolve()),
        "set": dict(map(parse_assignment, overrides)),
        "factors": [{"key": "seed", "kind": "values", "values": list(range(loaded.seed, loaded.seed + seeds))}],
        "variants": {COMPLETE: {}, **{part.name: {part.key: part.neutral} for part in parts}},
    }
    return parse_sweep(write_yaml(document), name=f"the ablation of {config}"), parts


def worths(sweep: Sweep, rows: Mapping[str, Row], parts: Sequence[Part]) -> tuple[Worth, ...]:
    """Return the effects of removing the parts, the largest first.

    Args:
        sweep: sweep of :func:`ablation_sweep`.
        rows: the finished points by their keys.
        parts: the removed parts.
    """
    found = [_worth(sweep, rows, part) for part in parts]
    return tuple(sorted(found, key=lambda each: (-each.lost, -_worst(each.changes))))


def _worst(changes: Sequence[Quantity]) -> float:
    return max((each.worsening or 0.0 for each in changes if each.limit is not None), default=0.0)


def _worth(sweep: Sweep, rows: Mapping[str, Row], part: Part) -> Worth:
    complete = {place(point, variant=False): rows.get(point.key) for point in sweep.points if point.variant == COMPLETE}
    pairs = [
        (first, second)
        for point in sweep.points
        if point.variant == part.name
        and (first := complete[place(point, variant=False)]) is not None
        and (second := rows.get(point.key)) is not None
        and first.ending.computed
        and second.ending.computed
    ]
    values = paired(pairs)
    passed = values.pop("passed", [])
    lost = math.fsum(first - second for first, second in passed) / max(len(pairs), 1)
    changes = list(_changes_of(values, len(pairs), sweep.points[0].config.gate.limits))
    changes.sort(key=lambda each: (each.limit is None, -(each.worsening or 0.0)))
    return Worth(part, share(sum(second == 1.0 for _, second in passed), len(pairs)), lost, tuple(changes))


_TINY = 1e-9
_NOT_JUDGED = ("_ms", "real_time_factor", "deadline_misses", "fell", "falls")


def _changes_of(
    values: Mapping[str, Sequence[tuple[float, float]]], count: int, limits: Mapping[str, float]
) -> Iterator[Quantity]:
    """Yield the change of each metric of control that was measured in all pairs."""
    for name, both in values.items():
        if len(both) < count or any(each in name for each in _NOT_JUDGED):
            continue
        complete, without = (math.fsum(each) / count for each in zip(*both, strict=True))
        stem = name.rpartition(".")[2]
        limit = next((limits[key] for key in limits if stem in (key, figure_of(key))), None)
        if abs(complete if limit is None else limit) >= _TINY:
            yield judged(name, complete, without, limit=limit)
