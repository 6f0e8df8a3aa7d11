from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lgmpc.errors import InputError, SolverError
from lgmpc.lie import checks, se3, sek3, so3
from lgmpc.lie.symbolic import sek3 as symbolic_sek3
from lgmpc.mechanics import SO3, UP, EulerPoincare, LieGroup, Symbols, heavy_top, munthe_kaas, torque_free_body

pytestmark = pytest.mark.usefixtures("interpreted")
INERTIA = np.array([[1.0, 0.1, -0.2], [0.1, 2.0, 0.15], [-0.2, 0.15, 2.5]])
START = so3.exp([0.4, -0.3, 0.9])
SPIN = np.array([0.7, -1.1, 0.5])


def quadratic(matrix: np.ndarray) -> Callable[[Symbols], ca.SX]:
    return lambda s: 0.5 * ca.dot(s.velocity, ca.DM(matrix) @ s.velocity)


def reference(field: Callable[[float, np.ndarray], np.ndarray], start: np.ndarray, end: float) -> np.ndarray:
    """The state at ``end``, by an integrator that does not use groups."""
    return solve_ivp(field, (0.0, end), start, method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]


def test_euler_equations_against_dop853_on_matrix_entries() -> None:
    def field(_: float, y: np.ndarray) -> np.ndarray:
        rotation, w = y[:9].reshape(3, 3), y[9:]
        return np.r_[(rotation @ so3.hat.unchecked(w)).ravel(), np.linalg.solve(INERTIA, np.cross(INERTIA @ w, w))]

    motion = torque_free_body(INERTIA).simulate(START, SPIN, step=1e-3, steps=5000, every=100)
    truth = reference(field, np.r_[START.ravel(), SPIN], 5.0)
    np.testing.assert_allclose(motion.poses[-1], truth[:9].reshape(3, 3), atol=1e-9)
    np.testing.assert_allclose(motion.velocities[-1], truth[9:], atol=1e-9)


def test_heavy_top_against_dop853_and_direction_carried_by_the_motion() -> None:
    moment, gravity = np.array([0.1, -0.2, 0.8]), 9.81

    def field(_: float, y: np.ndarray) -> np.ndarray:
        w, up = y[:3], y[3:]
        torque = gravity * np.cross(up, moment)
        return np.r_[np.linalg.solve(INERTIA, np.cross(INERTIA @ w, w) + torque), np.cross(up, w)]

    system = heavy_top(INERTIA, moment)
    motion = system.simulate(START, SPIN, START.T @ UP, step=1e-3, steps=3000, every=10)
    truth = reference(field, np.r_[SPIN, START.T @ UP], 3.0)
    np.testing.assert_allclose(np.r_[motion.velocities[-1], motion.advected[-1]], truth, atol=1e-9)
    np.testing.assert_allclose(np.swapaxes(motion.poses, 1, 2) @ UP, motion.advected, atol=1e-12)
    np.testing.assert_allclose(system.energies(motion), system.energies(motion)[0], rtol=1e-9)
    np.testing.assert_allclose(system.noether_momenta(motion)[:, 2], system.noether_momenta(motion)[0, 2], rtol=1e-9)


@pytest.mark.parametrize("system", [torque_free_body(INERTIA), heavy_top(INERTIA, [0.1, -0.2, 0.8])])
def test_order_is_the_slope_of_the_error(system: EulerPoincare) -> None:
    advected = None if system.advected is None else START.T @ UP

    def end(steps: int) -> tuple[np.ndarray, np.ndarray]:
        motion = system.simulate(START, SPIN, advected, step=1.0 / steps, steps=steps)
        return motion.poses[-1], motion.velocities[-1]

    pose, velocity = end(2048)
    coarse, fine = ((np.linalg.norm(p - pose), np.linalg.norm(v - velocity)) for p, v in map(end, (16, 32)))
    assert np.log2(np.divide(coarse, fine)) == pytest.approx([4.0, 4.0], abs=0.25)


def test_poses_stay_on_the_group_for_a_long_time() -> None:
    motion = torque_free_body(INERTIA).simulate(START, 3 * SPIN, step=0.05, steps=20000, every=20000)
    np.testing.assert_allclose(motion.poses[-1].T @ motion.poses[-1], np.eye(3), atol=1e-11)
    np.testing.assert_allclose(motion.times, [0.0, 1000.0])


def test_right_reduction_is_that_of_the_inverse_motion() -> None:
    """``g' = xi g`` with ``mu' = -coadjoint(xi) mu`` keeps the body momentum (chapter 4.4.7, appendix on that form)."""
    system = EulerPoincare("inverse", SO3, quadratic(INERTIA))
    motion = system.simulate(START.T, -SPIN, step=1e-3, steps=2000)
    poses, velocities = np.swapaxes(motion.poses, 1, 2), -motion.velocities
    momenta = velocities @ INERTIA
    rate = -np.cross(momenta, velocities)  # -coadjoint(xi) mu
    np.testing.assert_allclose(np.gradient(momenta, 1e-3, axis=0)[1:-1], rate[1:-1], atol=1e-5 * np.abs(rate).max())
    body = np.einsum("nji,nj->ni", poses, momenta)
    np.testing.assert_allclose(body, np.tile(body[0], (len(body), 1)), atol=1e-11)


def test_potential_and_advected_quantity_give_one_motion() -> None:
    moment = np.array([0.1, -0.2, 0.8])
    reduced = heavy_top(INERTIA, moment, 9.81)
    unreduced = EulerPoincare(
        "pendulum", SO3, quadratic(INERTIA), potential=lambda s: 9.81 * (s.pose @ ca.DM(moment))[2]
    )
    one = reduced.simulate(START, SPIN, START.T @ UP, step=1e-3, steps=1000)
    two = unreduced.simulate(START, SPIN, step=1e-3, steps=1000)
    np.testing.assert_allclose(one.poses, two.poses, atol=1e-11)
    np.testing.assert_allclose(reduced.energies(one), unreduced.energies(two), atol=1e-10)


def test_lagrangian_that_is_not_quadratic_is_solved_for_the_acceleration() -> None:
    """A "relativistic" sphere, turned about one axis: ``mu' = F`` integrates in closed form."""
    system = EulerPoincare(
        "relativistic",
        SO3,
        lambda s: -ca.sqrt(1.0 - ca.sumsqr(s.velocity)),
        body_force=lambda s: ca.DM([0.5, 0.0, 0.0]),
    )
    motion = system.simulate(np.eye(3), [0.0, 0.6, 0.0], step=1e-2, steps=200)
    momentum = np.stack((0.5 * motion.times, np.full(201, 0.75), np.zeros(201)), axis=1)
    speed = momentum / np.sqrt(1.0 + (momentum**2).sum(axis=1, keepdims=True))
    np.testing.assert_allclose(motion.velocities, speed, atol=1e-9)
    np.testing.assert_allclose(system.momenta(motion), momentum, atol=1e-8)


def test_extended_poses_carry_two_vectors() -> None:
    group = LieGroup("se23", 9, 5, sek3, symbolic_sek3, checks.extended_pose)
    mass = np.eye(9) + 0.1 * np.ones((9, 9))
    system = EulerPoincare("extended", group, quadratic(mass))
    motion = system.simulate(np.eye(5), np.linspace(-1, 1, 9), step=1e-3, steps=1000, every=100)
    np.testing.assert_allclose(np.ptp(system.noether_momenta(motion), axis=0), 0.0, atol=1e-9)
    np.testing.assert_allclose(np.ptp(system.energies(motion)), 0.0, atol=1e-9)


def test_other_parameters_compile_nothing_anew() -> None:
    one, two = torque_free_body(INERTIA), torque_free_body(2.0 * INERTIA)
    assert str(munthe_kaas(one).serialize()) == str(munthe_kaas(two).serialize())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"step": 0.0}, "step: got 0.0; expected a positive"),
        ({"step": -1e-3}, "step: got"),
        ({"step": np.nan}, "step: got NaN or infinity"),
        ({"steps": 0}, "steps: got 0"),
        ({"every": 3}, "every: got 3; expected a divisor"),
        ({"pose": 2 * np.eye(3)}, "pose: .* a rotation"),
        ({"pose": np.eye(4)}, "pose: got shape"),
        ({"velocity": [1.0, np.inf, 0.0]}, "velocity: .* finite"),
        ({"velocity": [1.0, 0.0]}, "velocity: got shape"),
        ({"advected": [1.0]}, "advected: got shape"),
    ],
)
def test_bad_arguments_are_named(change: dict[str, object], message: str) -> None:
    arguments = {"pose": np.eye(3), "velocity": SPIN, "advected": None, "step": 0.1, "steps": 10, **change}
    with pytest.raises(InputError, match=message):
        torque_free_body(INERTIA).simulate(
            arguments.pop("pose"), arguments.pop("velocity"), arguments.pop("advected"), **arguments
        )


def test_lagrangians_that_are_not_reduced_or_not_regular_are_refused() -> None:
    with pytest.raises(InputError, match="lagrangian: got one that depends on the pose"):
        EulerPoincare("l", SO3, lambda s: ca.sumsqr(s.velocity) - s.pose[2, 2])
    with pytest.raises(InputError, match=r"lagrangian: got an expression of shape \(3, 1\)"):
        EulerPoincare("l", SO3, lambda s: s.velocity)
    indefinite = EulerPoincare("l", SO3, quadratic(np.diag([1.0, 1.0, -1.0])))
    with pytest.raises(InputError, match="lagrangian: .* positive definite"):
        indefinite.simulate(np.eye(3), SPIN, step=0.1, steps=1)


def test_a_motion_that_blows_up_is_an_error() -> None:
    system = EulerPoincare("runaway", SO3, quadratic(np.eye(3)), body_force=lambda s: ca.exp(s.velocity**2))
    with pytest.raises(SolverError, match="Take a shorter step"):
        system.simulate(np.eye(3), [1.0, 0.0, 0.0], step=0.1, steps=100)


def test_placements_are_refused_where_they_are_not() -> None:
    with pytest.raises(InputError, match="pose: got shape"):
        torque_free_body(INERTIA).simulate(se3.identity(), SPIN, step=0.1, steps=1)
