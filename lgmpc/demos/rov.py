"""Underwater vehicles: a robot's righting moment and terminal speed, and the instability of a torpedo.

Chapter 4.12.4.
"""

import casadi as ca
import numpy as np
from scipy.special import ellipk

from lgmpc.demos.outcome import Body, Curve, Outcome, Panel, Path, Row, Shape, largest
from lgmpc.lie import se3, so3
from lgmpc.mechanics import Motion, discrete_euler_poincare
from lgmpc.mechanics.rigid_body import SpatialInertia
from lgmpc.mechanics.underwater import UnderwaterVehicle, spheroid_added_mass
from lgmpc.typing import GRAVITY, Array

STEP, DURATION = 5e-3, 20.0
"""s."""
FRAME, SCENE = 0.02, (1.5, 5.0)
"""Time between two pictures, s, and the interval shown: around the torpedo's first turn."""

# A BlueROV2 Heavy, rounded: Wu, "6-DoF modelling and control of a remotely operated vehicle", thesis, Flinders 2018.
ADDED = np.array([5.5, 12.7, 14.6, 0.12, 0.12, 0.12])
LINEAR = np.array([4.0, 6.2, 5.2, 0.07, 0.07, 0.07])
QUADRATIC = np.array([18.2, 21.7, 37.0, 1.55, 1.55, 1.55])
MASS, ROLL_INERTIA = 11.5, 0.16
TURNING = np.diag([ROLL_INERTIA, 0.16, 0.2])

LENGTH, DIAMETER, SPEED = 1.6, 0.2, 1.5
"""Length of the torpedo, m, and its speed, m/s."""
TILT = 1e-3
"""Initial angle of its path, rad."""


def run() -> Outcome:
    """Return the outcome, computed in a few seconds."""
    rows: list[Row] = []
    rise, final = _rise(rows)
    swing = _swing(rows)
    torpedo, growth, straight = _torpedo(rows)
    slip = np.abs(torpedo.velocities[:, 1])
    shown = slice(round(SCENE[0] / STEP), round(SCENE[1] / STEP) + 1, round(FRAME / STEP))
    times = torpedo.times[shown]
    return Outcome(
        tuple(rows),
        panels=(
            Panel.over_time(
                "The robot, 2 N of lift, released",
                "speed upwards, m/s",
                Curve("simulated", rise.times, rise.velocities[:, 2]),
                Curve("terminal speed", rise.times[[0, -1]], np.array([final, final]), dashed=True),
            ),
            Panel.over_time(
                "Righting moment: roll of the robot, undamped",
                "roll, deg",
                Curve("", swing.times, np.degrees(_roll(swing.poses))),
            ),
            Panel.over_time(
                "Munk instability of the torpedo",
                "sideways speed, m/s",
                Curve("simulated", torpedo.times[1:], slip[1:]),
                Curve("linearised", straight.times, slip[0] * np.exp(growth * straight.times), dashed=True),
                log_y=True,
            ),
            Panel("Path of the torpedo", "x, m", "y, m", (Curve("", *torpedo.poses[:, :2, 3].T),)),
        ),
        times=times,
        bodies=_scene(rise, torpedo.poses[shown], times),
        paths=(Path("torpedo's path", torpedo.poses[shown, :3, 3], 0xE45756),),
        remarks=(
            "Long bodies in ideal fluid turn broadside: their added mass is larger across the long axis than along it.",
            "The torpedo, without fins or damping, reverses periodically; Kirchhoff's Casimirs are conserved.",
        ),
    )


def _rise(rows: list[Row]) -> tuple[Motion, float]:
    """Simulate the robot, 2 N lighter than water, released at rest; the second result is its terminal speed."""
    force = 2.0
    body = SpatialInertia(MASS, np.zeros(3), TURNING)
    robot = UnderwaterVehicle(body, ADDED, LINEAR, QUADRATIC, MASS * GRAVITY + force, np.array([0.0, 0.0, 0.02]))
    motion = robot.system().simulate(np.eye(4), np.zeros(6), step=STEP, steps=round(DURATION / STEP))
    speeds = motion.velocities[:, 2]
    # The solution of m v' = force - linear v - quadratic v^2.
    linear, root = LINEAR[2], np.sqrt(LINEAR[2] ** 2 + 4.0 * QUADRATIC[2] * force)
    final = float(2.0 * force / (linear + root))
    decay = np.exp(-root / (MASS + ADDED[2]) * motion.times)
    closed = final * (1.0 - decay) / (1.0 + (root - linear) / (root + linear) * decay)
    rows.append(Row("robot: terminal speed upwards, 2 N of lift", final, float(speeds[-1]), 1e-6, "m/s"))
    rows.append(Row("robot: speed, off the closed form", 0.0, largest(speeds - closed), 1e-9, "m/s"))
    return motion, final


def _swing(rows: list[Row]) -> Motion:
    """Simulate the robot, neutral and undamped, released at a roll of 60 degrees."""
    weight, height, start = MASS * GRAVITY, 0.02, np.radians(60.0)
    body = SpatialInertia(MASS, np.zeros(3), TURNING)
    robot = UnderwaterVehicle(body, ADDED, buoyancy=weight, center_of_buoyancy=np.array([0.0, 0.0, height]))
    omega = np.sqrt(weight * height / (ROLL_INERTIA + ADDED[3]))
    period = float(4.0 * ellipk(np.sin(start / 2.0) ** 2) / omega)
    pose = se3.from_parts(so3.exp(np.array([start, 0.0, 0.0])), np.zeros(3))
    motion = robot.system().simulate(pose, np.zeros(6), step=period / 2000.0, steps=4000)
    back = float(np.degrees(_roll(motion.poses)[2000]))
    rows.append(Row(f"robot: roll after the pendulum's period, {period:.3f} s", 60.0, back, 1e-6, "deg"))
    return motion


def _torpedo(rows: list[Row]) -> tuple[Motion, float, Motion]:
    """Simulate a neutral spheroid in ideal fluid near its long axis: the motion, its growth rate and its start."""
    a, b = LENGTH / 2.0, DIAMETER / 2.0
    mass = 4.0 / 3.0 * np.pi * 1000.0 * a * b**2
    inertia = mass / 5.0 * np.diag([2.0 * b**2, a**2 + b**2, a**2 + b**2])
    added = spheroid_added_mass(LENGTH, DIAMETER)
    vehicle = UnderwaterVehicle(SpatialInertia(mass, np.zeros(3), inertia), added, buoyancy=mass * GRAVITY)
    m1, m2, turning = mass + added[0], mass + added[1], float(inertia[2, 2]) + added[5]
    growth = float(SPEED * np.sqrt(m1 * (m2 - m1) / (m2 * turning)))
    system = vehicle.system()
    s = system.symbols()
    slope = system.function("slope", s, slope=ca.jacobian(system.acceleration(*s.arguments), s.velocity))
    straight = slope(0.0, np.eye(4), SPEED * np.eye(6)[0], [], system.parameters)
    mode = np.linalg.eigvals(straight.full()).real.max()
    rows.append(Row("torpedo: growth rate, closed form and eigenvalue", growth, float(mode), 1e-9, "1/s"))

    # On the growing mode, with a small rotation about the long axis.
    slip = TILT * SPEED
    start = np.eye(4), np.array([SPEED, slip, 0.0, 1e-3, 0.0, -growth * m2 * slip / (m1 * SPEED)])
    motion = system.simulate(*start, step=STEP, steps=round(DURATION / STEP), method=discrete_euler_poincare)
    early = system.simulate(*start, step=STEP, steps=round(3.0 / growth / STEP))
    grown = np.log(early.velocities[-1, 1] / slip) / early.times[-1]
    body, space = system.momenta(motion), system.noether_momenta(motion)[:, :3]
    norms, helicity = np.linalg.norm(body[:, :3], axis=1), np.einsum("ni,ni->n", body[:, :3], body[:, 3:])
    rows += [
        Row("torpedo: growth rate of the slip, simulated", growth, float(grown), 1e-3 * growth, "1/s"),
        Row("torpedo: Casimir |p|, relative drift", 0.0, largest(norms / norms[0] - 1.0), 1e-12),
        Row("torpedo: Casimir p.l, drift", 0.0, largest(helicity - helicity[0]), 1e-10, "N2.s2.m"),
        Row("torpedo: spatial momentum, drift", 0.0, largest(space - space[0]), 1e-10, "N.s"),
    ]
    return motion, growth, early


def _roll(placements: Array) -> Array:
    return np.arctan2(placements[:, 2, 1], placements[:, 1, 1])


def _scene(rise: Motion, torpedo: Array, times: Array) -> tuple[Body, ...]:
    index = np.round((times - times[0]) / STEP).astype(int)  # released when the scene begins
    robot = (
        Shape("box", (0.46, 0.34, 0.12), (0.0, 0.0, 0.08), 0x4C78A8),
        Shape("box", (0.4, 0.3, 0.1), (0.0, 0.0, -0.05), 0x333333),
        Shape("sphere", (0.06, 0.06, 0.06), (0.22, 0.0, -0.02), 0x9ECAE9, 0.8),
    )
    hull = (
        Shape("ellipsoid", (LENGTH / 2.0, DIAMETER / 2.0, DIAMETER / 2.0), color=0xF2B701),
        Shape("sphere", (0.05, 0.05, 0.05), (LENGTH / 2.0 - 0.05, 0.0, 0.0), 0x333333),
    )
    aside = np.array([np.mean(SCENE) * SPEED, 1.2, 0.0])
    return (
        Body("robot", robot, rise.poses[index, :3, 3] + aside, rise.poses[index, :3, :3]),
        Body("torpedo", hull, torpedo[:, :3, 3], torpedo[:, :3, :3]),
    )
