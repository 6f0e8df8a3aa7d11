"""Noether's theorem: symmetries and conserved momenta of a body in several potentials.

Chapter 4.13.4. The prediction is the number of directions in which the Lagrangian is invariant, the measurement the
number of conserved components of the spatial momentum over several motions of each system.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from lgmpc.demos.outcome import Body, Curve, Outcome, Panel, Path, Row, Shape, largest
from lgmpc.mechanics import (
    HEIGHT,
    UP,
    EulerPoincare,
    LeftSymmetry,
    Motion,
    SpatialInertia,
    conserved_dimension,
    free_body,
    heavy_top,
)
from lgmpc.typing import GRAVITY, Array

_EDGES = np.array([0.3, 0.2, 0.1])  # of a box, m
_MASS = 1.5  # kg
_BOX = SpatialInertia(_MASS, np.array([0.06, 0.03, 0.02]), np.diag(_MASS / 12.0 * (np.sum(_EDGES**2) - _EDGES**2)))
_STEP, _STEPS, _EVERY = 2.5e-4, 8000, 80


@dataclass(frozen=True, eq=False)
class _Case:
    """A system, and the dimension of its symmetry group, counted by hand."""

    name: str
    system: EulerPoincare
    symmetries: int


_CASES = (
    _Case("free", free_body(_BOX), 6),
    _Case("in gravity", free_body(_BOX, GRAVITY), 3),
    _Case("on an elastic, level plane", free_body(_BOX, GRAVITY, potential=lambda s: 60.0 * s.pose[2, 3] ** 2), 3),
    _Case(
        "in a round bowl",
        free_body(_BOX, GRAVITY, potential=lambda s: 20.0 * ca.sumsqr(s.pose[:2, 3]) + 60.0 * s.pose[2, 3] ** 2),
        1,
    ),
    _Case(
        "in an elliptic bowl",
        free_body(
            _BOX,
            GRAVITY,
            potential=lambda s: 20.0 * s.pose[0, 3] ** 2 + 30.0 * s.pose[1, 3] ** 2 + 60.0 * s.pose[2, 3] ** 2,
        ),
        0,
    ),
    _Case("held at a point", heavy_top(_BOX.about_origin, _MASS * _BOX.center, GRAVITY), 1),
)


def run() -> Outcome:
    """Return the outcome, computed in a few seconds."""
    rows: list[Row] = []
    shown: dict[str, tuple[Motion, Array]] = {}
    for case in _CASES:
        motions = [_move(case, seed) for seed in (2, 1, 0)]
        momenta = [case.system.noether_momenta(motion) for motion in motions]
        symmetry = LeftSymmetry(case.system)
        directions = symmetry.directions(motions)
        rows += [
            Row(f"{case.name}: symmetries", case.symmetries, len(directions), 0.0),
            Row(f"{case.name}: conserved momenta", len(directions), conserved_dimension(momenta), 0.0),
        ]
        if len(directions):
            scale = max(map(largest, momenta))
            drift = max(largest((table - table[0]) @ directions.T) for table in momenta) / scale
            rows.append(Row(f"{case.name}: relative change of these", 0.0, drift, 1e-9))
        shown[case.name] = motions[0], momenta[0]
    rows += _falling(*shown["in gravity"])
    motion = shown["in a round bowl"][0]
    return Outcome(
        tuple(rows),
        tuple(_panel(name, *shown[name]) for name in ("free", "in gravity", "in a round bowl", "held at a point")),
        motion.times,
        (_body(motion),),
        (Path("origin of the body's frame", motion.poses[:, :3, 3], 0xE45756),),
        (
            "Under gravity p_x, p_y and L_z are conserved, by horizontal translation and rotation about the vertical.",
            "A frictionless level plane breaks no further symmetry; a bowl or a fixed point leaves only L_z conserved.",
        ),
    )


def _move(case: _Case, seed: int) -> Motion:
    """Return a motion from a random initial state: any attitude, half a metre of displacement, tumbling."""
    rng = np.random.default_rng(seed)
    group = case.system.group
    small = np.full(group.dim, 0.5)
    pose = group.numeric.exp(small * rng.normal(size=group.dim))
    velocity = 2.0 * small * rng.normal(size=group.dim)
    world = UP if group.size == 3 else HEIGHT
    return case.system.simulate(pose, velocity, pose.T @ world, step=_STEP, steps=_STEPS, every=_EVERY)


def _falling(motion: Motion, momenta: Array) -> list[Row]:
    """Compare the rates of momentum under gravity with the weight and its moment about the world's origin."""
    time = float(motion.times[-1])
    rates = np.diff(momenta[[0, -1]], axis=0)[0] / time
    start, turn = motion.poses[0], motion.velocities[0]
    center = start[:3, 3] + start[:3, :3] @ _BOX.center
    speed = start[:3, :3] @ (turn[:3] + np.cross(turn[3:], _BOX.center))
    moment = np.cross(center + speed * time / 2.0, -_MASS * GRAVITY * UP)  # its mean over the fall
    return [
        Row("in gravity: rate of p_z", -_MASS * GRAVITY, float(rates[2]), 1e-9, "N"),
        Row("in gravity: mean rate of L_x", float(moment[0]), float(rates[3]), 1e-9, "N.m"),
        Row("in gravity: mean rate of L_y", float(moment[1]), float(rates[4]), 1e-9, "N.m"),
    ]


def _panel(name: str, motion: Motion, momenta: Array) -> Panel:
    labels = ("p_x", "p_y", "p_z", "L_x", "L_y", "L_z")[-momenta.shape[1] :]
    return Panel.over_time(f"Spatial momentum: {name}", "N.s, N.m.s", *Curve.each(labels, motion.times, momenta))


def _body(motion: Motion) -> Body:
    center = (float(_BOX.center[0]), float(_BOX.center[1]), float(_BOX.center[2]))
    shapes = (
        Shape("box", (float(_EDGES[0]), float(_EDGES[1]), float(_EDGES[2])), center, 0x4C78A8),
        Shape("sphere", (0.02, 0.02, 0.02), color=0xE69F00),
    )
    return Body("box", shapes, motion.poses[:, :3, 3], motion.poses[:, :3, :3])
