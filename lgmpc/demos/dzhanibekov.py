"""Dzhanibekov's effect: a T-handle that spins about its middle axis flips periodically.

Chapter 4.12.1: rotation about the axis of the middle moment of inertia is unstable. The integrated equations of motion
are compared with the closed form in Jacobi's elliptic functions.
"""

import math

import numpy as np
import pinocchio as pin
from scipy.interpolate import CubicHermiteSpline

from lgmpc.demos.outcome import Body, Curve, Outcome, Panel, Path, Row, Shape, largest
from lgmpc.lie import so3
from lgmpc.mechanics import EulerTop, Motion, torque_free_body
from lgmpc.typing import Array

# A bar along y and a stem along x, steel cylinders: masses (kg), radii and lengths (m).
_BAR = (0.23, 0.007, 0.19)
_STEM = (0.11, 0.008, 0.07)
_SPIN = 6.0  # rad/s, about the stem
_TILT = 0.02  # angle of the initial angular velocity from the stem
_STEP = 1e-3  # s


def run() -> Outcome:
    """Return the outcome, computed in a few seconds."""
    inertia, stem = _handle()
    top = EulerTop(inertia, _SPIN * np.array([math.cos(_TILT), 0.6 * math.sin(_TILT), 0.8 * math.sin(_TILT)]))
    motion = _simulate(top, 3.2 * top.flip_interval)
    system = torque_free_body(inertia)
    end = float(motion.times[-1])
    found, predicted = _crossings(inertia, motion), top.flips(end)
    energies, momenta = system.energies(motion), system.noether_momenta(motion)
    drift = largest(momenta - momenta[0]) / top.momentum
    exact = top.velocities(motion.times)
    rows = (
        Row("flips", float(len(predicted)), float(len(found)), 0.0),
        *(Row(f"flip {k + 1} at", float(t), float(found[k]), 1e-9, "s") for k, t in enumerate(predicted[: len(found)])),
        Row("time between flips", top.flip_interval, float(np.mean(np.diff(found))), 1e-9, "s"),
        Row("rate at which a small tilt grows", _growth(inertia), _measured_growth(inertia), 1e-5, "1/s"),
        *(_stable_row(inertia, axis, name) for axis, name in ((1, "long"), (2, "short"))),
        Row("angular velocity off the closed form", 0.0, largest(motion.velocities - exact), 1e-8, "rad/s"),
        Row("relative change of energy", 0.0, float(np.ptp(energies) / energies[0]), 1e-10),
        Row("relative change of angular momentum", 0.0, drift, 1e-9),
    )
    panels = (
        Panel.over_time(
            "Angular velocity (dashed: elliptic)",
            "rad/s",
            *Curve.each("xyz", motion.times[::20], motion.velocities[::20]),
            *Curve.each(("", "", ""), motion.times[::20], exact[::20], dashed=True),
        ),
        Panel.over_time(
            "Direction of the stem",
            "cosine of its angle to the momentum",
            Curve("", motion.times[::20], motion.poses[::20, :, 0] @ momenta[0] / top.momentum),
        ),
    )
    shown = slice(None, None, 25)
    return Outcome(
        rows,
        panels,
        motion.times[shown],
        (_body(stem, motion.poses[shown]),),
        (Path("tip of the stem", motion.poses[shown] @ stem, 0xE69F00),),
        (
            "Energy and angular momentum alone determine the times of the flips.",
            "Rotation about the other two axes is stable.",
        ),
    )


def _handle() -> tuple[Array, Array]:
    """Return the inertia (3, 3) about the handle's centre of mass, and the tip of its stem (3,) relative to it."""
    (bar, bar_radius, bar_length), (stem, stem_radius, stem_length) = _BAR, _STEM
    along_y, along_x = (pin.utils.rotate(axis, 0.5 * math.pi) for axis in "xy")
    middle = np.array([stem_length / 2.0, 0.0, 0.0])
    handle = pin.Inertia.FromCylinder(bar, bar_radius, bar_length).se3Action(pin.SE3(along_y, np.zeros(3)))
    handle += pin.Inertia.FromCylinder(stem, stem_radius, stem_length).se3Action(pin.SE3(along_x, middle))
    return np.array(handle.inertia), np.array([stem_length, 0.0, 0.0]) - handle.lever


def _simulate(top: EulerTop, end: float) -> Motion:
    return torque_free_body(top.inertia).simulate(top.rotation, top.velocity, step=_STEP, steps=round(end / _STEP))


def _crossings(inertia: Array, motion: Motion) -> Array:
    """Return the times at which the angular velocity about the stem changes sign, interpolated by cubics."""
    w = motion.velocities
    rates = np.linalg.solve(inertia, np.cross(w @ inertia, w).T).T
    return CubicHermiteSpline(motion.times, w[:, 0], rates[:, 0]).roots(extrapolate=False)


def _growth(inertia: Array) -> float:
    """Return the growth rate about the middle axis, linearised: ``sqrt((I2 - I1) (I3 - I2) / (I1 I3)) Omega``."""
    middle, low, high = np.diag(inertia)
    return float(math.sqrt((middle - low) * (high - middle) / (low * high)) * _SPIN)


def _measured_growth(inertia: Array) -> float:
    top = EulerTop(inertia, np.array([_SPIN, 1e-9, 1e-9]))
    motion = _simulate(top, 12.0 / _growth(inertia))  # after half of the time the decaying mode is reduced to exp(-12)
    late = len(motion.times) // 2
    tilts = np.linalg.norm(motion.velocities[late:, 1:], axis=1)
    return float(np.polyfit(motion.times[late:], np.log(tilts), 1)[0])


def _stable_row(inertia: Array, axis: int, name: str) -> Row:
    """Return the row of another axis: the smallest angular velocity about it over the largest."""
    velocity = np.full(3, _SPIN * math.sin(_TILT) / math.sqrt(2.0))
    velocity[axis] = _SPIN * math.cos(_TILT)
    top = EulerTop(inertia, velocity)
    about = _simulate(top, top.period).velocities[:, axis]
    crossing = top.flips(top.period)[:1]  # dn is extreme where sn is 0 and where cn is
    extremes = top.velocities(np.append(crossing, crossing + top.period / 4.0))[:, axis]
    ratio = float(extremes.min() / extremes.max())
    return Row(f"about the {name} axis: least over largest spin", ratio, float(about.min() / about.max()), 1e-8)


def _body(tip: Array, rotations: Array) -> Body:
    (_, bar_radius, bar_length), (_, stem_radius, stem_length) = _BAR, _STEM
    root = float(tip[0]) - stem_length
    shapes = (
        Shape(
            "cylinder",
            (bar_radius, bar_radius, bar_length),
            (root, 0.0, 0.0),
            0x4C78A8,
            rotation=so3.exp(np.array([math.pi / 2.0, 0.0, 0.0])),
        ),
        Shape(
            "cylinder",
            (stem_radius, stem_radius, stem_length),
            (root + stem_length / 2.0, 0.0, 0.0),
            0xE69F00,
            rotation=so3.exp(np.array([0.0, math.pi / 2.0, 0.0])),
        ),
    )
    return Body("handle", shapes, np.zeros((len(rotations), 3)), rotations)
