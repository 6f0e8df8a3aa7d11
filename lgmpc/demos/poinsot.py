"""A free body's ellipsoid of inertia rolls on a plane in space without slipping: Poinsot's picture of its motion.

Chapter 4.5.3 and 4.10.5. The motion comes from integrated equations; the construction predicts everything about it.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from lgmpc.demos.outcome import Body, Curve, Demo, Outcome, Panel, Path, Row, Shape
from lgmpc.lie import so3
from lgmpc.mechanics import EulerTop, Motion, Poinsot, torque_free_body
from lgmpc.typing import Array

__all__ = ["DEMO"]

_MOMENTS = np.array([4.0, 9.0, 12.0])  # kg.m^2
_VELOCITY = np.array([1.1, 0.6, 1.6])  # rad/s
_STEPS = 20000  # a period


def _run() -> Outcome:
    top = EulerTop(np.diag(_MOMENTS), _VELOCITY)
    # The momentum upright, the plane below: the world is turned so that the picture stands.
    up = top.inertia @ _VELOCITY / top.momentum
    down = np.array([0.0, 0.0, -1.0])
    axis = np.cross(up, down)
    turn = so3.exp(axis / np.linalg.norm(axis) * math.acos(float(up @ down)))
    top = EulerTop(top.inertia, top.velocity, turn)
    construction = Poinsot(top)
    motion = _simulate(top)

    contact = motion.velocities / math.sqrt(2.0 * top.energy)
    world = np.einsum("nij,nj->ni", motion.poses, contact)
    heights = world @ construction.normal
    radii = np.linalg.norm(world - heights[:, None] * construction.normal, axis=1)
    low, high = construction.radii
    ellipsoid = np.einsum("ni,ij,nj->n", contact, top.inertia, contact)
    momenta = motion.velocities @ top.inertia
    on_body, on_plane = _lengths(top, motion, contact, world)
    turned = so3.log(so3.project(motion.poses[-1] @ motion.poses[0].T)) @ construction.normal
    predicted_turn = math.remainder(float(top.azimuths(np.array([top.period]))[0]), 2.0 * math.pi)
    rows = (
        Row("lowest point of contact from the centre", construction.distance, float(heights.min()), 1e-10),
        Row("highest point of contact from the centre", construction.distance, float(heights.max()), 1e-10),
        Row("contact off the ellipsoid", 0.0, float(np.abs(ellipsoid - 1.0).max()), 1e-10),
        Row("path on the plane, as long as the one on the body", on_body, on_plane, 1e-11),
        Row("inner radius of the herpolhode", low, float(radii.min()), 1e-9),
        Row("outer radius of the herpolhode", high, float(radii.max()), 1e-9),
        Row("polhode closes after a period", 0.0, float(np.linalg.norm(contact[-1] - contact[0])), 1e-9),
        Row("turn about the momentum in a period", predicted_turn, float(turned), 1e-8, "rad"),
        Row("radius of the momentum sphere", top.momentum, float(np.linalg.norm(momenta[-1])), 1e-9, "N.m.s"),
    )
    many = _rolled(top, 7)
    herpolhode = construction.herpolhode(many)
    shown = slice(None, None, 100)
    panels = (
        Panel(
            "Herpolhode, on the plane (dashed: its bounds)",
            "x",
            "y",
            (
                Curve("herpolhode", herpolhode[:, 0], herpolhode[:, 1]),
                *(Curve("", r * np.cos(_CIRCLE), r * np.sin(_CIRCLE), dashed=True) for r in (low, high)),
            ),
            equal=True,
        ),
        Panel(
            "Angular momentum in the body: circles its axis of largest moment",
            "x, N.m.s",
            "y, N.m.s",
            (Curve("polhode", momenta[shown, 0], momenta[shown, 1]),),
            equal=True,
        ),
    )
    times = many[::4]
    rotations = top.rotations(times)
    return Outcome(
        rows,
        panels,
        times,
        (
            Body("ellipsoid", _ellipsoid(construction, contact[shown]), np.zeros((len(times), 3)), rotations),
            _plane(construction, len(times)),
        ),
        (Path("herpolhode", herpolhode, 0xE45756),),
        (
            "Lengths are those of the ellipsoid x^T J x = 1.",
            "The point of contact is on the instantaneous axis: there the body is at rest, so it rolls.",
        ),
    )


_CIRCLE = np.linspace(0.0, 2.0 * math.pi, 181)


def _simulate(top: EulerTop) -> Motion:
    return torque_free_body(top.inertia).simulate(top.rotation, top.velocity, step=top.period / _STEPS, steps=_STEPS)


def _lengths(top: EulerTop, motion: Motion, contact: Array, world: Array) -> tuple[float, float]:
    """Lengths of the two curves of contact in a period, by midpoints of the same time intervals.

    The one on the body from its points and Euler's equations, the one on the plane from its points alone: nothing of
    the rolling is put in.
    """
    w = motion.velocities
    rates = np.linalg.solve(top.inertia, np.cross(w @ top.inertia, w).T).T / math.sqrt(2.0 * top.energy)
    middle = (motion.times[1:] + motion.times[:-1]) / 2.0
    on_body = CubicHermiteSpline(motion.times, contact, rates).derivative()(middle)
    h = motion.times[1]
    # Fourth-order differences at the middles of the intervals that have two neighbours.
    on_plane = (27.0 * (world[2:-1] - world[1:-2]) - (world[3:] - world[:-3])) / (24.0 * h)
    first = float(h * np.linalg.norm(on_body[1:-1], axis=1).sum())
    return first, float(h * np.linalg.norm(on_plane, axis=1).sum())


def _rolled(top: EulerTop, periods: int) -> Array:
    times: Array = np.linspace(0.0, periods * top.period, 400 * periods + 1)
    return times


def _ellipsoid(construction: Poinsot, polhode: Array) -> tuple[Shape, ...]:
    (a, b, c), axes = construction.semi_axes
    dots = tuple(Shape("sphere", (0.006, 0.006, 0.006), (x, y, z), 0xE69F00) for x, y, z in polhode.tolist())
    return (Shape("ellipsoid", (float(a), float(b), float(c)), color=0x4C78A8, opacity=0.8, rotation=axes), *dots)


def _plane(construction: Poinsot, count: int) -> Body:
    thickness = 0.004
    shape = Shape("box", (1.2, 1.2, thickness), color=0x9DA7B1, opacity=0.5)
    position = (construction.distance + thickness / 2.0) * construction.normal
    return Body("plane", (shape,), np.tile(position, (count, 1)), np.tile(np.eye(3), (count, 1, 1)))


DEMO = Demo("poinsot", "A free body's ellipsoid of inertia rolls on a plane without slipping", _run)
