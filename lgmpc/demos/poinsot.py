"""Poinsot's construction: a free body's ellipsoid of inertia rolls on a fixed plane without slipping.

Chapter 4.5.3 and 4.10.5. The motion is integrated; the construction predicts its properties.
"""

import math

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from lgmpc.demos.outcome import Body, Curve, Outcome, Panel, Path, Row, Shape, largest
from lgmpc.lie import so3
from lgmpc.mechanics import EulerTop, Motion, Poinsot, torque_free_body
from lgmpc.typing import Array

_MOMENTS = np.array([4.0, 9.0, 12.0])  # kg.m^2
_VELOCITY = np.array([1.6, 0.5, 1.3])  # rad/s
_STEPS = 20000  # per period


def run() -> Outcome:
    """Return the outcome, computed in a few seconds."""
    top = EulerTop(np.diag(_MOMENTS), _VELOCITY)
    # The world is rotated so that the momentum is vertical and the plane is below.
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
    # The rate of the first axis' azimuth about the momentum, in closed form, and its mean over a period.
    grid: Array = np.linspace(0.0, top.period, 2000, endpoint=False)
    own = (_MOMENTS[0] * top.velocities(grid)[:, 0]) ** 2
    rate = top.momentum * (2.0 * top.energy - own / _MOMENTS[0]) / (top.momentum**2 - own)
    predicted_turn = math.remainder(top.period * float(rate.mean()), 2.0 * math.pi)
    rows = (
        Row("lowest point of contact from the centre", construction.distance, float(heights.min()), 1e-10),
        Row("highest point of contact from the centre", construction.distance, float(heights.max()), 1e-10),
        Row("contact off the ellipsoid", 0.0, largest(ellipsoid - 1.0), 1e-10),
        Row("path on the plane, as long as the one on the body", on_body, on_plane, 1e-11),
        Row("inner radius of the herpolhode", low, float(radii.min()), 1e-8),
        Row("outer radius of the herpolhode", high, float(radii.max()), 1e-8),
        Row("polhode closes after a period", 0.0, float(np.linalg.norm(contact[-1] - contact[0])), 1e-9),
        Row("turn about the momentum in a period", predicted_turn, float(turned), 1e-8, "rad"),
        Row("radius of the momentum sphere", top.momentum, float(np.linalg.norm(momenta[-1])), 1e-9, "N.m.s"),
    )
    longer = _simulate(top, periods=7, every=_STEPS // 400)
    herpolhode = np.einsum("nij,nj->ni", longer.poses, longer.velocities) / math.sqrt(2.0 * top.energy)
    shown = slice(None, None, 100)
    panels = (
        Panel(
            "Herpolhode, on the plane (dashed: its bounds)",
            "x",
            "y",
            (
                Curve("", herpolhode[:, 0], herpolhode[:, 1]),
                *(Curve("", r * np.cos(_CIRCLE), r * np.sin(_CIRCLE), dashed=True) for r in (low, high)),
            ),
            equal=True,
        ),
        Panel(
            "Momentum sphere: its polhode, others",
            "N.m.s",
            "N.m.s",
            (Curve("this motion", *_seen(momenta[shown])), *_other_polhodes(top.momentum)),
            equal=True,
        ),
    )
    times, rotations = longer.times[::4], longer.poses[::4]
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
            "The point of contact is on the instantaneous axis: its velocity is zero, so the body rolls.",
        ),
    )


_CIRCLE = np.linspace(0.0, 2.0 * math.pi, 181)


def _simulate(top: EulerTop, periods: int = 1, every: int = 1) -> Motion:
    step, steps = top.period / _STEPS, periods * _STEPS
    return torque_free_body(top.inertia).simulate(top.rotation, top.velocity, step=step, steps=steps, every=every)


def _lengths(top: EulerTop, motion: Motion, contact: Array, world: Array) -> tuple[float, float]:
    """Return the lengths of the two curves of contact in a period, by midpoints of the same time intervals.

    That on the body is computed from its points and Euler's equations, that on the plane from its points alone:
    rolling is not assumed.
    """
    w = motion.velocities
    rates = np.linalg.solve(top.inertia, np.cross(w @ top.inertia, w).T).T / math.sqrt(2.0 * top.energy)
    middle = (motion.times[1:] + motion.times[:-1]) / 2.0
    on_body = CubicHermiteSpline(motion.times, contact, rates).derivative()(middle)
    h = motion.times[1]
    # Fourth-order differences at the midpoints of the inner intervals.
    on_plane = (27.0 * (world[2:-1] - world[1:-2]) - (world[3:] - world[:-3])) / (24.0 * h)
    first = float(h * np.linalg.norm(on_body[1:-1], axis=1).sum())
    return first, float(h * np.linalg.norm(on_plane, axis=1).sum())


def _seen(points: Array) -> tuple[Array, Array]:
    """Return the coordinates of points on the visible side of a sphere from the body's first octant; NaN for others."""
    toward = np.array([0.75, 0.35, 0.56])
    toward /= np.linalg.norm(toward)
    right = np.cross([0.0, 0.0, 1.0], toward)
    right /= np.linalg.norm(right)
    near = np.where(points @ toward > 0.0, 1.0, np.nan)
    return near * (points @ right), near * (points @ np.cross(toward, right))


def _other_polhodes(momentum: float) -> list[Curve]:
    """Return polhodes of the same angular momentum: around the third axis, around the first, and the separatrix."""
    low, middle, high = 1.0 / _MOMENTS[::-1]
    # Momenta in the plane of the first and third axis at this angle from the third have |pi|^2 = 2 E I2.
    between = math.atan(math.sqrt((middle - low) / (high - middle)))
    parts = np.linspace(0.15, 0.9, 5)
    curves = []
    for angle in (*(parts * between), *(between + parts * (np.pi / 2.0 - between)), between):
        top = EulerTop(np.diag(_MOMENTS), momentum * np.array([math.sin(angle), 0.0, math.cos(angle)]) / _MOMENTS)
        half = min(top.period / 2.0, 15.0)
        around = top.velocities(np.linspace(-half, half, 601)) * _MOMENTS
        mirrors = ([1, 1, 1], [-1, -1, -1], [1, 1, -1], [-1, -1, 1]) if angle == between else ([1, 1, 1], [-1, -1, -1])
        curves += [Curve("", *_seen(around * mirror), dashed=True) for mirror in mirrors]
    return curves


def _ellipsoid(construction: Poinsot, polhode: Array) -> tuple[Shape, ...]:
    (a, b, c), axes = construction.semi_axes
    dots = tuple(Shape("sphere", (0.011, 0.011, 0.011), (x, y, z), 0xE69F00) for x, y, z in polhode.tolist())
    return (Shape("ellipsoid", (float(a), float(b), float(c)), color=0x4C78A8, opacity=0.55, rotation=axes), *dots)


def _plane(construction: Poinsot, count: int) -> Body:
    thickness = 0.004
    shape = Shape("box", (1.2, 1.2, thickness), color=0x9DA7B1, opacity=0.5)
    position = (construction.distance + thickness / 2.0) * construction.normal
    return Body("plane", (shape,), np.tile(position, (count, 1)), np.tile(np.eye(3), (count, 1, 1)))
