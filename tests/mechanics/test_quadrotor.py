"""Geometric control of a quadrotor: exact references, the antipode, and comparison with an Euler-angle PID."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from lgmpc.errors import InputError
from lgmpc.lie import so3
from lgmpc.lie.attitude import roll_pitch_yaw
from lgmpc.mechanics.quadrotor import (
    AttitudeCommand,
    EulerAnglePid,
    EulerGains,
    FlatOutput,
    GeometricController,
    GeometricGains,
    Hover,
    Lissajous,
    Quadrotor,
    QuadrotorState,
    attitude_error,
    fly,
)
from lgmpc.mechanics.quadrotor.control import angle_rates

QUADROTOR = Quadrotor.of_the_paper()
GAINS = GeometricGains.of_the_paper()
REAL = QUADROTOR.limited(lift=2.5, moment=20.0)


@dataclass
class TurnOnly:
    """The attitude's controller alone, holding the identity; no thrust."""

    controller: GeometricController

    def control(self, time, state):
        still = np.zeros_like(state.rate)
        command = AttitudeCommand(np.broadcast_to(np.eye(3), state.rotation.shape), still, still)
        return np.zeros(state.rate.shape[:-1]), self.controller.moment(state, command)


def states_at(flight, k) -> QuadrotorState:
    s = flight.states
    return QuadrotorState(s.position[k], s.velocity[k], s.rotation[k], s.rate[k])


def turn_only(start, duration, step=2e-3, gains=None):
    return fly(QUADROTOR, TurnOnly(GeometricController(QUADROTOR, Hover(), gains)), start, duration, step)


def test_the_errors_mean_an_angle() -> None:
    angle, axis = 2.1, np.array([1.0, 2.0, -1.0]) / np.sqrt(6.0)
    desired = Rotation.random(random_state=1).as_matrix()
    psi, error = attitude_error(desired @ so3.exp(angle * axis), desired)
    assert psi == pytest.approx(1.0 - np.cos(angle), abs=1e-14)
    assert np.allclose(error, np.sin(angle) * axis, atol=1e-14)


def test_the_desired_rates_are_exact_derivatives_along_the_flight() -> None:
    """Far from the trajectory, so that every term of acceleration and jerk counts."""
    controller = GeometricController(QUADROTOR, Lissajous())
    start = QuadrotorState.at_rest(so3.exp(np.array([0.9, -0.4, 0.3])), (0.3, -0.2, 0.4))
    step = 1e-3
    flight = fly(QUADROTOR, controller, start, 0.21, step)
    for k in (50, 130, 201):
        ahead, here, behind = (controller.command(flight.times[k + i], states_at(flight, k + i)) for i in (1, 0, -1))
        rate = so3.vee(0.5 * (m := here.rotation.T @ (ahead.rotation - behind.rotation) / (2 * step)) - 0.5 * m.T)
        assert np.allclose(here.rate, rate, atol=2e-4 * max(np.abs(here.rate).max(), 1.0))
        acceleration = (ahead.rate - behind.rate) / (2 * step)
        assert np.allclose(here.acceleration, acceleration, atol=2e-3 * max(np.abs(acceleration).max(), 1.0))


def test_the_error_of_those_differences_falls_with_the_square_of_the_step() -> None:
    controller = GeometricController(QUADROTOR, Lissajous())
    start = QuadrotorState.at_rest(so3.exp(np.array([0.9, -0.4, 0.3])), (0.3, -0.2, 0.4))
    flight = fly(QUADROTOR, controller, start, 0.09, 2.5e-4)
    errors, k = [], 200
    here = controller.command(flight.times[k], states_at(flight, k)).acceleration
    for n in (8, 16, 32):
        ahead, behind = (controller.command(flight.times[k + i], states_at(flight, k + i)).rate for i in (n, -n))
        errors.append(np.linalg.norm((ahead - behind) / (2 * n * 2.5e-4) - here))
    slopes = np.diff(np.log2(errors))
    assert np.all(np.abs(slopes - 2.0) < 0.1), (errors, slopes)


def test_a_start_on_the_trajectory_stays_on_it() -> None:
    trajectory = Lissajous()
    controller = GeometricController(QUADROTOR, trajectory)
    wanted = trajectory.at(0.0).position
    first = QuadrotorState(wanted[0], wanted[1], np.eye(3), np.zeros(3))
    # Without errors of position and velocity the attitude follows from the acceleration, the rate from the jerk.
    turned = QuadrotorState(wanted[0], wanted[1], controller.command(0.0, first).rotation, np.zeros(3))
    spun = QuadrotorState(wanted[0], wanted[1], turned.rotation, controller.command(0.0, turned).rate)
    start = QuadrotorState(wanted[0], wanted[1], turned.rotation, controller.command(0.0, spun).rate)
    errors = []
    for step in (4e-3, 2e-3):
        flight = fly(QUADROTOR, controller, start, 0.4, step)
        goal = np.array([trajectory.at(t).position[0] for t in flight.times])
        errors.append(np.abs(flight.states.position - goal).max())
    assert errors[1] < 1e-8
    assert 3.5 < np.log2(errors[0] / errors[1]) < 4.5


def test_about_a_principal_axis_it_is_a_damped_pendulum() -> None:
    """``J theta'' = -k_R sin theta - k_Omega theta'``, which scipy solves to 1e-12."""
    starts, inertia = np.radians([30.0, 178.0, 179.99]), QUADROTOR.inertia[0, 0]
    flight = turn_only(QuadrotorState.at_rest(so3.exp(starts[:, None] * [1.0, 0.0, 0.0])), 1.0)
    exact = solve_ivp(
        lambda _, y: np.r_[y[3:], (-GAINS.rotation * np.sin(y[:3]) - GAINS.rate * y[3:]) / inertia],
        (0.0, 1.0),
        np.r_[starts, np.zeros(3)],
        "DOP853",
        flight.times,
        rtol=1e-13,
        atol=1e-13,
    ).y[:3]
    angles = np.unwrap(roll_pitch_yaw(flight.states.rotation)[..., 0], axis=0)
    assert np.abs(angles - exact.T).max() < 4e-9  # 2.4e-9, and at half the step 1.5e-10
    assert np.all(np.abs(angles[-1]) < starts)


def test_exactly_at_the_antipode_the_moment_vanishes() -> None:
    """Half a turn is an equilibrium; ``lgmpc demo lee`` measures the rate at which a start beside it leaves."""
    flight = turn_only(QuadrotorState.at_rest(np.diag([1.0, -1.0, -1.0])), 0.2)
    psi, _ = attitude_error(flight.states.rotation, np.eye(3))
    assert np.all(psi == 2.0) and np.all(flight.moments == 0.0)


UNEVEN = GeometricGains([60.0, 80.0, 50.0], [20.0, 25.0, 30.0], [8.0, 3.0, 12.0], [2.5, 1.5, 3.0])


def test_the_lyapunov_function_never_rises() -> None:
    """``1/2 Omega^T J Omega + Psi`` has the derivative ``-Omega . k_Omega Omega``."""
    rotations = Rotation.random(50, random_state=4).as_matrix()
    gains = UNEVEN
    flight = turn_only(QuadrotorState.at_rest(rotations), 1.0, gains=gains)
    psi, _ = attitude_error(flight.states.rotation, np.eye(3), gains.rotation)
    omega = flight.states.rate
    energy = 0.5 * np.sum(omega * (omega @ QUADROTOR.inertia), axis=-1) + psi
    assert np.diff(energy, axis=0).max() < 1e-12
    # A trapezoidal sum over 2 ms: h^2/12 times a bend of the integrand of about a thousand.
    lost = np.trapezoid(np.sum(gains.rate * omega**2, axis=-1), dx=2e-3, axis=0)
    assert np.allclose(energy[0] - energy[-1], lost, rtol=2e-3)


def test_stiffness_per_axis_is_the_gradient_of_its_error_function() -> None:
    """``e_R = K phi`` near the goal; ``dPsi = e_R . d`` for a turn ``R exp(d)`` anywhere."""
    stiffness, desired = np.array([8.0, 3.0, 12.0]), Rotation.random(random_state=1).as_matrix()
    small = 1e-6 * np.array([1.0, -2.0, 0.5])
    psi, error = attitude_error(desired @ so3.exp(small), desired, stiffness)
    assert np.allclose(error, stiffness * small, rtol=1e-5)
    assert psi == pytest.approx(0.5 * small @ (stiffness * small), rel=1e-3)
    rotation, step = Rotation.random(random_state=2).as_matrix(), 1e-5
    _, error = attitude_error(rotation, desired, stiffness)
    ahead, behind = (attitude_error(rotation @ so3.exp(s * step * np.eye(3)), desired, stiffness)[0] for s in (1, -1))
    assert np.allclose((ahead - behind) / (2 * step), error, atol=1e-8)


def test_gains_per_axis_make_each_axis_a_pendulum_of_its_own() -> None:
    flight = turn_only(QuadrotorState.at_rest(so3.exp(2.0 * np.eye(3))), 1.0, gains=UNEVEN)
    for axis in range(3):
        inertia, k, c = QUADROTOR.inertia[axis, axis], UNEVEN.rotation[axis], UNEVEN.rate[axis]
        exact = solve_ivp(
            lambda _, y, k=k, c=c, inertia=inertia: [y[1], (-k * np.sin(y[0]) - c * y[1]) / inertia],
            (0.0, 1.0),
            [2.0, 0.0],
            "DOP853",
            flight.times,
            rtol=1e-12,
            atol=1e-12,
        ).y[0]
        assert np.allclose(so3.log(flight.states.rotation[:, axis])[:, axis], exact, atol=1e-8)


def test_gains_of_position_act_on_the_axes_of_the_world() -> None:
    start = QuadrotorState(np.array([0.3, -0.2, 0.1]), np.array([0.1, 0.4, -0.2]), np.eye(3), np.zeros(3))
    axis = GeometricController(QUADROTOR, Hover(), UNEVEN).command(0.0, start).rotation[:, 2]
    force = np.array([0.0, 0.0, QUADROTOR.weight]) - UNEVEN.position * start.position - UNEVEN.velocity * start.velocity
    assert np.allclose(axis, force / np.linalg.norm(force), atol=1e-14)
    flight = fly(QUADROTOR, GeometricController(QUADROTOR, Hover(), UNEVEN), start, 4.0, 1e-2)
    assert np.linalg.norm(flight.states.position[-1]) < 0.01


def test_three_gains_that_are_alike_are_one() -> None:
    alike = GeometricGains(*(np.full(3, gain) for gain in vars(GAINS).values()))
    start = QuadrotorState.at_rest(so3.exp(np.array([0.9, -0.4, 0.3])), (0.3, -0.2, 0.4))
    commands = [GeometricController(QUADROTOR, Lissajous(), gains).control(0.3, start) for gains in (GAINS, alike)]
    assert np.array_equal(commands[0][1], commands[1][1]) and commands[0][0] == commands[1][0]


GOAL = Hover((0.0, 0.0, 10.0))


def away(flight) -> np.ndarray:
    """Distance from the goal at the end; infinite for a vehicle that was lost."""
    distance = np.linalg.norm(flight.states.position[-1] - GOAL.point, axis=-1)
    return np.where(flight.lost, np.inf, distance)


@pytest.mark.parametrize("kind", [GeometricController, EulerAnglePid])
def test_both_recover_from_rest_upside_down_and_from_small_tilts(kind) -> None:
    starts = so3.exp(np.radians([[178.0, 0.0, 0.0], [20.0, 0.0, 0.0], [0.0, -25.0, 0.0], [10.0, 10.0, 40.0]]))
    flight = fly(REAL, kind(REAL, GOAL), QuadrotorState.at_rest(starts, GOAL.point), 6.0, 1e-2)
    assert (away(flight) < 0.02).all()


def test_a_vehicle_that_spins_too_fast_is_reported_as_lost() -> None:
    start = QuadrotorState(
        np.zeros((2, 3)), np.zeros((2, 3)), np.tile(np.eye(3), (2, 1, 1)), np.diag([1.0, 80.0, 0])[:2]
    )
    flight = fly(QUADROTOR, Idle(), start, 0.1, 1e-2)
    assert flight.lost.tolist() == [False, True]
    assert np.isfinite(flight.states.rotation).all()
    assert np.array_equal(flight.states.position[-1, 1], np.zeros(3))


def test_euler_rates_are_derivatives_of_euler_angles() -> None:
    rng = np.random.default_rng(8)
    rotation, omega, step = so3.exp(rng.uniform(-0.8, 0.8, 3)), rng.normal(size=3), 1e-6
    ahead, behind = (roll_pitch_yaw(rotation @ so3.exp(s * step * omega)) for s in (1, -1))
    assert np.allclose(angle_rates(roll_pitch_yaw(rotation), omega), (ahead - behind) / (2 * step), atol=1e-8)
    assert np.allclose(roll_pitch_yaw(rotation)[::-1], Rotation.from_matrix(rotation).as_euler("ZYX"), atol=1e-13)


class Idle:
    def control(self, time, state):
        return np.zeros(()), np.zeros(3)


def test_a_free_body_keeps_its_momentum_and_falls_on_a_parabola_to_order_four() -> None:
    omega = np.array([3.0, -5.0, 4.0])
    start = QuadrotorState(np.zeros(3), np.array([1.0, 0.0, 2.0]), np.eye(3), omega)
    drifts = []
    for step in (4e-3, 2e-3):
        flight = fly(QUADROTOR, Idle(), start, 1.0, step)
        momentum = np.einsum("kij,kj->ki", flight.states.rotation, flight.states.rate @ QUADROTOR.inertia)
        drifts.append(np.abs(momentum - momentum[0]).max())
        fall = start.velocity - 0.5 * np.array([0.0, 0.0, 9.81])
        assert np.allclose(flight.states.position[-1], fall, atol=1e-12)
    assert drifts[1] < 1e-9
    assert 3.7 < np.log2(drifts[0] / drifts[1]) < 5.5


def test_a_lissajous_curve_has_its_own_derivatives() -> None:
    curve, t, step = Lissajous(), 0.7, 1e-5
    ahead, behind, here = curve.at(t + step), curve.at(t - step), curve.at(t)
    for values in ("position", "heading"):
        slope = (getattr(ahead, values) - getattr(behind, values))[:-1] / (2 * step)
        assert np.allclose(slope, getattr(here, values)[1:], atol=1e-7)


class Parallel:
    def at(self, time):
        return FlatOutput(np.zeros((5, 3)), np.array([[0.0, 0.0, 1.0], [0.0] * 3, [0.0] * 3]))


def test_a_batch_of_no_vehicles_flies() -> None:
    none = QuadrotorState.at_rest(np.zeros((0, 3, 3)))
    assert fly(QUADROTOR, GeometricController(QUADROTOR, Hover()), none, 0.01).lost.shape == (0,)


def test_bad_input_is_refused() -> None:
    with pytest.raises(InputError, match="mass: got 0"):
        Quadrotor(0.0, np.eye(3))
    with pytest.raises(InputError, match="a positive definite matrix"):
        Quadrotor(1.0, np.diag([1.0, 1.0, -0.1]))
    with pytest.raises(InputError, match="symmetric"):
        Quadrotor(1.0, np.eye(3) + np.triu(np.ones((3, 3)), 1))
    with pytest.raises(InputError, match="thrust"):
        Quadrotor(1.0, np.eye(3), (1.0, 1.0))
    with pytest.raises(InputError, match="moment"):
        QUADROTOR.limited(2.0, -1.0)
    with pytest.raises(InputError, match="rate: got -1"):
        GeometricGains(1.0, 1.0, 1.0, -1.0)
    with pytest.raises(InputError, match="rotation: got .* a positive number, or three of them"):
        GeometricGains(1.0, 1.0, np.ones(2), 1.0)
    with pytest.raises(InputError, match="velocity: got"):
        GeometricGains(1.0, np.array([1.0, 0.0, 1.0]), 1.0, 1.0)
    with pytest.raises(InputError, match="integral: got -1"):
        EulerGains(integral=-1.0)
    with pytest.raises(InputError, match="point"):
        Hover((0.0, np.nan, 0.0))
    with pytest.raises(InputError, match="heading: .* a direction"):
        Hover(heading=(0.0, 0.0, 0.0))
    with pytest.raises(InputError, match="step"):
        fly(QUADROTOR, Idle(), QuadrotorState.at_rest(np.eye(3)), 1.0, 0.0)
    with pytest.raises(InputError):
        QuadrotorState.at_rest(2.0 * np.eye(3))
    with pytest.raises(InputError, match="position"):
        QuadrotorState.at_rest(np.eye(3), (np.nan, 0.0, 0.0))
    with pytest.raises(InputError, match="frequency"):
        Lissajous(frequency=(1.0, np.inf, 0.0))
    with pytest.raises(InputError, match=r"amplitude: got shape \(2,\)"):
        Lissajous(amplitude=(1.0, 2.0))  # type: ignore[arg-type]
    with pytest.raises(InputError, match="yaw_rate: .* finite"):
        Lissajous(yaw_rate=np.nan)
    state = QuadrotorState.at_rest(np.eye(3))
    with pytest.raises(InputError, match="heading: got parallel"):
        GeometricController(QUADROTOR, Parallel()).control(0.0, state)
    # So far above the goal that the desired force vanishes.
    above = QuadrotorState.at_rest(np.eye(3), (0.0, 0.0, QUADROTOR.weight / GAINS.position))
    with pytest.raises(InputError, match="desired force of zero"):
        GeometricController(QUADROTOR, Hover()).control(0.0, above)
