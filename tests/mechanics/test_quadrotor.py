"""Geometric control of a quadrotor: exact references, the antipode, and comparison with Euler angles."""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from lgmpc.errors import InputError
from lgmpc.lie import se3, so3
from lgmpc.lie.attitude import roll_pitch_yaw
from lgmpc.mechanics import HEIGHT, Motion, torque_free_body
from lgmpc.mechanics.quadrotor import (
    EulerAngleController,
    GeometricController,
    GeometricGains,
    Quadrotor,
    attitude_error,
    euler_angles,
    euler_rates,
    hover,
    lissajous,
)

QUADROTOR = Quadrotor.of_the_paper()
GAINS = GeometricGains.of_the_paper()
REAL = QUADROTOR.limited(lift=2.5, moment=20.0)
STILL = np.zeros(3)
TILTED = so3.exp(np.array([0.9, -0.4, 0.3]))


def turn_only(rotations, duration, step=2e-3) -> list[Motion]:
    """The attitude's controller alone, towards the identity."""
    controller = GeometricController(QUADROTOR, hover())
    body = torque_free_body(
        QUADROTOR.inertia, body_force=lambda s: controller.moment(s.pose, s.velocity, ca.DM.eye(3), STILL, STILL)
    )
    return [body.simulate(r, STILL, step=step, steps=round(duration / step)) for r in rotations]


def flown(controller, rotation, position, duration, step, velocity=STILL, rate=STILL) -> Motion:
    pose, twist = se3.from_parts(rotation, position), np.concatenate((rotation.T @ velocity, rate))
    system = controller.quadrotor.system(controller)
    return system.simulate(pose, twist, pose.T @ HEIGHT, step=step, steps=round(duration / step))


def commanded(controller, motion, k) -> tuple[np.ndarray, ...]:
    """Attitude, rate and acceleration that a controller asks for at a step of a motion."""
    rotation, velocity = motion.poses[k, :3, :3], motion.velocities[k]
    found = controller.command(motion.times[k], motion.poses[k, :3, 3], rotation @ velocity[:3], rotation, velocity[3:])
    return found[1].full(), found[2].full().ravel(), found[3].full().ravel()


def errors(rotation, desired) -> tuple[float, np.ndarray]:
    psi, error = attitude_error(rotation, desired)
    return float(psi), error.full().ravel()


def test_the_errors_mean_an_angle() -> None:
    angle, axis = 2.1, np.array([1.0, 2.0, -1.0]) / np.sqrt(6.0)
    desired = Rotation.random(random_state=1).as_matrix()
    psi, error = errors(desired @ so3.exp(angle * axis), desired)
    assert psi == pytest.approx(1.0 - np.cos(angle), abs=1e-14)
    assert np.allclose(error, np.sin(angle) * axis, atol=1e-14)


@pytest.mark.parametrize("vehicle", [QUADROTOR, QUADROTOR.limited(lift=1.2, moment=20.0)])
def test_the_desired_rates_are_exact_derivatives_along_the_flight(vehicle) -> None:
    """Far from the trajectory, so that every term of acceleration and jerk counts; with a saturated thrust too."""
    controller = GeometricController(vehicle, lissajous())
    motion = flown(controller, TILTED, np.array([0.3, -0.2, 0.4]), 0.21, 1e-3)
    for k in (50, 130, 201):
        ahead, here, behind = (commanded(controller, motion, k + i) for i in (1, 0, -1))
        slope = here[0].T @ (ahead[0] - behind[0]) / 2e-3
        assert np.allclose(here[1], so3.vee(0.5 * (slope - slope.T)), atol=2e-4 * max(np.abs(here[1]).max(), 1.0))
        acceleration = (ahead[1] - behind[1]) / 2e-3
        assert np.allclose(here[2], acceleration, atol=2e-3 * max(np.abs(acceleration).max(), 1.0))


def test_the_error_of_those_differences_falls_with_the_square_of_the_step() -> None:
    controller = GeometricController(QUADROTOR, lissajous())
    motion, k = flown(controller, TILTED, np.array([0.3, -0.2, 0.4]), 0.09, 2.5e-4), 200
    here, off = commanded(controller, motion, k)[2], []
    for n in (8, 16, 32):
        ahead, behind = (commanded(controller, motion, k + i)[1] for i in (n, -n))
        off.append(np.linalg.norm((ahead - behind) / (2 * n * 2.5e-4) - here))
    slopes = np.diff(np.log2(off))
    assert np.all(np.abs(slopes - 2.0) < 0.1), (off, slopes)


def test_a_start_on_the_trajectory_stays_on_it() -> None:
    """The distance falls with the fourth power of the step."""
    controller, t = GeometricController(QUADROTOR, lissajous()), ca.SX.sym("t")
    position = controller.reference(t)[0]
    curve = ca.Function("curve", [t], [position, ca.jacobian(position, t)])
    place, speed = (value.full().ravel() for value in curve(0.0))
    # Without errors of position and velocity the attitude follows from the acceleration, the rate from the jerk.
    rotation, rate = np.eye(3), STILL
    for _ in range(3):
        _, rotation, rate, _ = (value.full() for value in controller.command(0.0, place, speed, rotation, rate))
    off = []
    for step in (4e-3, 2e-3):
        motion = flown(controller, rotation, place, 0.4, step, speed, rate.ravel())
        goal = np.array([curve(time)[0].full().ravel() for time in motion.times])
        off.append(np.abs(motion.poses[:, :3, 3] - goal).max())
    assert off[1] < 1e-8
    assert 3.5 < np.log2(off[0] / off[1]) < 4.5


def test_about_each_principal_axis_it_is_a_damped_pendulum() -> None:
    """``J theta'' = -k_R sin theta - k_Omega theta'``, which scipy solves to 1e-12."""
    k, c = GAINS.rotation, GAINS.rate
    for start in np.radians([115.0, 179.99]):
        for axis, motion in enumerate(turn_only(so3.exp(start * np.eye(3)), 1.0)):
            inertia = QUADROTOR.inertia[axis, axis]
            exact = solve_ivp(
                lambda _, y, inertia=inertia: [y[1], (-k * np.sin(y[0]) - c * y[1]) / inertia],
                (0.0, 1.0),
                [start, 0.0],
                "DOP853",
                motion.times,
                rtol=1e-13,
                atol=1e-13,
            ).y[0]
            angles = so3.log(motion.poses)[:, axis]
            assert np.abs(angles - exact).max() < 1e-8
            assert abs(angles[-1]) < start


def test_exactly_at_the_antipode_the_moment_vanishes() -> None:
    """Half a turn is an equilibrium; ``lgmpc demo lee`` measures the rate at which a start beside it leaves."""
    half = np.diag([1.0, -1.0, -1.0])
    motion = turn_only([half], 0.2)[0]
    assert np.array_equal(motion.poses[-1], half) and not motion.velocities.any()
    assert errors(half, np.eye(3))[0] == 2.0


def test_the_lyapunov_function_never_rises() -> None:
    """``1/2 Omega^T J Omega + k_R Psi`` has the derivative ``-k_Omega |Omega|^2``."""
    for motion in turn_only(Rotation.random(20, random_state=4).as_matrix(), 1.0):
        psi = np.array([errors(pose, np.eye(3))[0] for pose in motion.poses])
        omega = motion.velocities
        energy = 0.5 * np.sum(omega * (omega @ QUADROTOR.inertia), axis=-1) + GAINS.rotation * psi
        assert np.diff(energy).max() < 1e-12
        # A trapezoidal sum over 2 ms: h^2/12 times a bend of the integrand of about a thousand.
        lost = np.trapezoid(np.sum(GAINS.rate * omega**2, axis=-1), dx=2e-3)
        assert np.isclose(energy[0] - energy[-1], lost, rtol=2e-3)


def test_the_error_is_the_gradient_of_its_error_function() -> None:
    """``dPsi = e_R . d`` for a turn ``R exp(d)`` anywhere."""
    rotation, desired = (Rotation.random(random_state=k).as_matrix() for k in (2, 1))
    step = 1e-5
    ahead, behind = (
        np.array([errors(rotation @ turn, desired)[0] for turn in so3.exp(s * step * np.eye(3))]) for s in (1, -1)
    )
    assert np.allclose((ahead - behind) / (2 * step), errors(rotation, desired)[1], atol=1e-9)


def test_the_desired_force_is_of_the_errors_in_the_world() -> None:
    place, speed = np.array([0.3, -0.2, 0.1]), np.array([0.1, 0.4, -0.2])
    controller = GeometricController(QUADROTOR, hover())
    force, desired, *_ = (value.full() for value in controller.command(0.0, place, speed, np.eye(3), STILL))
    expected = np.array([0.0, 0.0, QUADROTOR.mass * 9.81]) - GAINS.position * place - GAINS.velocity * speed
    assert np.allclose(force.ravel(), expected, rtol=1e-14)
    assert np.allclose(desired[:, 2], expected / np.linalg.norm(expected), atol=1e-14)
    motion = flown(controller, np.eye(3), place, 4.0, 1e-2, speed)
    assert np.linalg.norm(motion.poses[-1, :3, 3]) < 0.01


@pytest.mark.parametrize("kind", [GeometricController, EulerAngleController])
def test_both_recover_from_rest_upside_down_and_from_small_tilts(kind) -> None:
    goal = np.array([0.0, 0.0, 10.0])
    controller = kind(REAL, hover(goal))
    for start in np.radians([[178.0, 0.0, 0.0], [20.0, 0.0, 0.0], [0.0, -25.0, 0.0], [10.0, 10.0, 40.0]]):
        motion = flown(controller, so3.exp(start), goal, 6.0, 1e-2)
        assert np.linalg.norm(motion.poses[-1, :3, 3] - goal) < 0.02


def test_euler_rates_are_derivatives_of_euler_angles() -> None:
    rng = np.random.default_rng(8)
    rotation, omega, step = so3.exp(rng.uniform(-0.8, 0.8, 3)), rng.normal(size=3), 1e-6
    here, ahead, behind = (ca.DM(euler_angles(rotation @ so3.exp(s * step * omega))).full() for s in (0, 1, -1))
    assert np.allclose(euler_rates(ca.DM(here), ca.DM(omega)).full(), (ahead - behind) / (2 * step), atol=1e-8)
    assert np.allclose(here.ravel(), roll_pitch_yaw(rotation), atol=1e-14)
    assert np.allclose(here.ravel()[::-1], Rotation.from_matrix(rotation).as_euler("ZYX"), atol=1e-13)


def test_limits_bound_thrust_and_moments() -> None:
    """A controller that asks for 1 kN upside down, and for moments of 1 kN.m."""
    limited = QUADROTOR.limited(lift=2.0, moment=0.5)
    asks = SimpleNamespace(control=lambda s: (1e3, ca.DM([1e3, -1e3, 0.0])), quadrotor=limited)
    motion = flown(asks, np.eye(3), STILL, 0.01, 1e-3)
    assert motion.velocities[-1, 2] == pytest.approx(9.81 * 0.01, rel=1e-3)
    assert np.allclose(
        motion.velocities[-1, 3:5], np.array([0.5, -0.5]) / np.diag(limited.inertia)[:2] * 0.01, rtol=1e-3
    )


def test_a_force_along_the_heading_or_of_zero_leaves_the_attitude_undefined() -> None:
    parallel = GeometricController(QUADROTOR, hover(heading=(0.0, 0.0, 1.0)))
    above = np.array([0.0, 0.0, QUADROTOR.mass * 9.81 / GAINS.position])
    for controller, place in ((parallel, STILL), (GeometricController(QUADROTOR, hover()), above)):
        assert np.isnan(controller.command(0.0, place, STILL, np.eye(3), STILL)[1].full()).any()


def test_bad_input_is_refused() -> None:
    with pytest.raises(InputError, match="mass: got 0"):
        Quadrotor(0.0, np.eye(3))
    with pytest.raises(InputError, match="a positive definite matrix"):
        Quadrotor(1.0, np.diag([1.0, 1.0, -0.1]))
    with pytest.raises(InputError, match="thrust"):
        Quadrotor(1.0, np.eye(3), (1.0, 1.0))
    with pytest.raises(InputError, match="moment"):
        QUADROTOR.limited(2.0, -1.0)
    with pytest.raises(InputError, match="rate: got -1"):
        GeometricGains(1.0, 1.0, 1.0, -1.0)
    with pytest.raises(InputError, match="rotation: got"):
        GeometricGains(1.0, 1.0, np.ones(2), 1.0)
    with pytest.raises(InputError, match="point"):
        hover((0.0, np.nan, 0.0))
    with pytest.raises(InputError, match="frequency"):
        lissajous(frequency=(1.0, np.inf, 0.0))
    with pytest.raises(InputError, match=r"amplitude: got shape \(2,\)"):
        lissajous(amplitude=(1.0, 2.0))
    with pytest.raises(InputError, match="yaw_rate: .* finite"):
        lissajous(yaw_rate=np.nan)
