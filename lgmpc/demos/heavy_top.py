"""Lagrange's top: precession, nutation, sleeping and falling, predicted by Lagrange's formulas.

Chapter 4.17. The simulation integrates the Euler-Poincare equations with the direction of gravity as advected quantity.
"""

import math

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from lgmpc.demos.outcome import Body, Curve, Outcome, Panel, Path, Row, Shape, largest
from lgmpc.mechanics import UP, LagrangeTop, Motion
from lgmpc.typing import GRAVITY, Array, IntArray

# A disc of 0.1 kg and 4 cm radius, 5 cm up a light axle.
_TOP = LagrangeTop(transverse=0.1 * (0.04**2 / 4.0 + 0.05**2), axial=0.1 * 0.04**2 / 2.0, weight=0.1 * GRAVITY * 0.05)
_TILT = 0.4  # rad
_SPIN = 1.5 * _TOP.critical_spin
_STEP = 1e-4  # s
_STAND = 0.05  # height of the pivot in the scene, m


def run() -> Outcome:
    """Return the outcome, computed in a few seconds."""
    slow, fast = _TOP.steady_precession(_TILT, _SPIN)
    rotation, velocity = _TOP.start(_TILT, _SPIN)
    nodding = _simulate(rotation, velocity, 2.0)
    nutation = _TOP.nutation(rotation, velocity)
    tilts = _tilts(nodding)
    turns = _turning_points(nodding)
    system = _TOP.system
    energies, momenta = system.energies(nodding), system.noether_momenta(nodding)
    body = system.momenta(nodding)
    scale = largest(momenta[0])
    falls = tuple(_disturbed(ratio * _TOP.critical_spin) for ratio in (0.8, 1.2))
    rows = (
        Row("slow precession", slow, _precession(slow), 1e-8, "rad/s"),
        Row("fast precession", fast, _precession(fast), 1e-6, "rad/s"),
        Row("nutation: least tilt", nutation.tilts[0], float(tilts.min()), 1e-6, "rad"),
        Row("nutation: largest tilt", nutation.tilts[1], float(tilts[turns].max()), 1e-6, "rad"),
        Row("nutation: period", nutation.period, _period(nodding), 1e-7, "s"),
        Row(
            "tilt off its elliptic function",
            0.0,
            largest(nodding.advected[:, 2] - nutation.cosines(nodding.times)),
            1e-8,
        ),
        Row("upright, 0.8 of the critical spin: falls to", _TOP.fall(0.8 * _TOP.critical_spin), falls[0], 1e-4, "rad"),
        Row("the same: a tilt grows at", _TOP.sleeping_growth(0.8 * _TOP.critical_spin), _growth(), 1e-4, "1/s"),
        Row(
            "upright, 1.2 of the critical spin: tilt stays",
            _TOP.nutation(*_disturbance(1.2 * _TOP.critical_spin)).tilts[1],
            falls[1],
            1e-7,
            "rad",
        ),
        Row("relative change of energy", 0.0, float(np.ptp(energies) / abs(energies[0])), 1e-9),
        Row("relative change of L_z, from the symmetry of gravity", 0.0, float(np.ptp(momenta[:, 2]) / scale), 1e-9),
        Row("relative change of pi_3, from the symmetry of the top", 0.0, float(np.ptp(body[:, 2]) / scale), 1e-9),
        Row("Casimir |Gamma|", 1.0, float(np.linalg.norm(nodding.advected[-1])), 1e-11),
    )
    axis = nodding.poses[:, :, 2]
    shown = slice(None, None, 10)
    panels = (
        Panel.over_time(
            "Released at rest: tilt (dashed: elliptic)",
            "deg",
            Curve("", nodding.times, np.degrees(tilts)),
            Curve("", nodding.times[shown], np.degrees(np.arccos(nutation.cosines(nodding.times)))[shown], dashed=True),
        ),
        Panel("Path of the axis, from above", "x", "y", (Curve("", axis[:, 0], axis[:, 1]),), equal=True),
        Panel("Falling from upright", "spin / critical spin", "greatest tilt, deg", _bifurcation()),
    )
    scene = 2.5
    return Outcome(
        rows,
        panels,
        nodding.times[shown],
        (_body(nodding.poses[shown], scene), _pivot(len(axis[shown]), scene)),
        (Path("axis", 0.12 * scene * axis[::2] + [0.0, 0.0, _STAND * scene], 0xE45756),),
        (
            "Released at rest, the axis moves in cusps; started at the rate of slow precession, its tilt is constant.",
            "Above the critical spin the upright top is stable: small disturbances stay small.",
        ),
        floor=True,
    )


def _simulate(rotation: Array, velocity: Array, end: float, step: float = _STEP) -> Motion:
    steps = 10 * math.ceil(end / step / 10.0)
    return _TOP.system.simulate(rotation, velocity, rotation.T @ UP, step=step, steps=steps, every=10)


def _tilts(motion: Motion) -> Array:
    """Return the angles of the axis from the vertical, accurate near it too."""
    return np.arctan2(np.linalg.norm(motion.advected[:, :2], axis=1), motion.advected[:, 2])


def _precession(rate: float) -> float:
    """Return the mean rate of precession from an initial state."""
    motion = _simulate(*_TOP.start(_TILT, _SPIN, rate), 0.5)
    azimuth = np.unwrap(np.arctan2(motion.poses[:, 1, 2], motion.poses[:, 0, 2]))
    return float((azimuth[-1] - azimuth[0]) / motion.times[-1])


def _turning_points(motion: Motion) -> IntArray:
    """Return the indices next to the maxima of the tilt."""
    u = motion.advected[:, 2]
    return np.flatnonzero((u[1:-1] <= u[:-2]) & (u[1:-1] <= u[2:])) + 1


def _period(motion: Motion) -> float:
    """Return the time between upward crossings of the mean tilt, by cubics through values and rates."""
    up, w = motion.advected, motion.velocities
    rates = up[:, 0] * w[:, 1] - up[:, 1] * w[:, 0]
    mean = (up[:, 2].min() + up[:, 2].max()) / 2.0
    spline = CubicHermiteSpline(motion.times, up[:, 2] - mean, rates)
    roots = spline.roots(extrapolate=False)
    rising = roots[spline(roots, 1) > 0.0]
    return float((rising[-1] - rising[0]) / (len(rising) - 1))


def _disturbance(spin: float, tilt: float = 1e-3) -> tuple[Array, Array]:
    """Return rotation and velocity of a nearly upright top, precessing at the rate of an upright one."""
    return _TOP.start(tilt, spin, _TOP.axial * spin / (2.0 * _TOP.transverse))


def _disturbed(spin: float, step: float = 2.0 * _STEP) -> float:
    """Return the largest tilt within one period of nutation."""
    start = _disturbance(spin)
    return float(_tilts(_simulate(*start, 1.05 * _TOP.nutation(*start).period, step)).max())


def _growth() -> float:
    """Return the growth rate of the tilt of a slow, upright top after the decaying mode has vanished."""
    spin = 0.8 * _TOP.critical_spin
    motion = _simulate(*_disturbance(spin, 1e-9), 14.0 / _TOP.sleeping_growth(spin), 2.0 * _STEP)
    late = motion.times > motion.times[-1] / 2.0
    return float(np.polyfit(motion.times[late], np.log(_tilts(motion)[late]), 1)[0])


def _bifurcation() -> tuple[Curve, ...]:
    ratios = np.array([0.1, 0.25, 0.4, 0.55, 0.7, 0.8, 0.9, 0.95, 0.98, 0.995, 1.0, 1.05, 1.15, 1.3])
    measured = np.degrees([_disturbed(float(ratio) * _TOP.critical_spin, 10.0 * _STEP) for ratio in ratios])
    fine = np.linspace(0.1, 1.3, 400)
    predicted = np.degrees([_TOP.fall(float(ratio) * _TOP.critical_spin) for ratio in fine])
    return Curve("simulated", ratios, measured), Curve("predicted", fine, predicted, dashed=True)


def _body(rotations: Array, scale: float) -> Body:
    shapes = (
        Shape("cylinder", (0.04 * scale, 0.04 * scale, 0.012 * scale), (0.0, 0.0, 0.05 * scale), 0x4C78A8),
        Shape("cylinder", (0.003 * scale, 0.003 * scale, 0.12 * scale), (0.0, 0.0, 0.06 * scale), 0x34414F),
        Shape(  # a spot on the disc, which shows its rotation
            "sphere", (0.006 * scale, 0.006 * scale, 0.006 * scale), (0.03 * scale, 0.0, 0.057 * scale), 0xE69F00
        ),
    )
    return Body("top", shapes, np.tile([0.0, 0.0, _STAND * scale], (len(rotations), 1)), rotations)


def _pivot(count: int, scale: float) -> Body:
    """Return the support: a cone with its tip at the fixed point."""
    cone = Shape("cone", (0.02 * scale, 0.02 * scale, _STAND * scale), (0.0, 0.0, 0.5 * _STAND * scale), 0x9DA7B1)
    return Body("pivot", (cone,), np.zeros((count, 3)), np.tile(np.eye(3), (count, 1, 1)))
