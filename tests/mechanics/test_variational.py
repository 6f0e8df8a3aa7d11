from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lgmpc.errors import InputError
from lgmpc.lie import se3, so3
from lgmpc.mechanics import SO3, UP, EulerPoincare, Motion, SpatialInertia, free_body, heavy_top, torque_free_body
from lgmpc.mechanics.euler_poincare import munthe_kaas
from lgmpc.mechanics.integrators import (
    discrete_euler_poincare,
    matrix_runge_kutta,
    moser_veselov,
    projected_runge_kutta,
)

Method = Callable[[EulerPoincare], ca.Function]


@dataclass(frozen=True, eq=False)
class Case:
    """A system and how it starts."""

    system: EulerPoincare
    pose: np.ndarray
    velocity: np.ndarray
    advected: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def run(self, method: Method, step: float, duration: float) -> Motion:
        return self.system.simulate(
            self.pose, self.velocity, self.advected, step=step, steps=round(duration / step), method=method
        )

    def row(self) -> np.ndarray:
        return np.concatenate((self.pose.ravel(order="F"), self.velocity, self.advected))

    def step(self, function: ca.Function, row: np.ndarray, h: float) -> np.ndarray:
        return function(0.0, h, row, self.system.parameters).full().ravel()


def last(motion: Motion) -> np.ndarray:
    return np.concatenate((motion.poses[-1].ravel(order="F"), motion.velocities[-1], motion.advected[-1]))


FREE = Case(torque_free_body(np.diag([1.0, 2.0, 3.0])), np.eye(3), np.array([1.0, 0.0, 0.8]))

J = np.array([[0.5, 0.02, 0.0], [0.02, 0.4, 0.01], [0.0, 0.01, 0.3]])
PULL = np.array([0.02, -0.05, 0.3])
TILT, SPIN = so3.exp([0.4, 0.2, 0.0]), np.array([0.3, -0.2, 6.0])
TOP = Case(heavy_top(J, PULL), TILT, SPIN, TILT.T @ UP)
POTENTIAL = Case(
    EulerPoincare(
        "top_in_a_potential",
        SO3,
        lambda s: ca.dot(s.velocity, ca.DM(J) @ s.velocity) / 2,
        potential=lambda s: 9.81 * s.pose[2, :] @ ca.DM(PULL),
    ),
    TILT,
    SPIN,
)

INERTIA = SpatialInertia(1.5, np.array([0.1, 0.05, -0.02]), np.diag([0.1, 0.2, 0.25]))
PLACED, THROWN = se3.exp([0.3, -0.2, 0.1, 0.5, 0.1, -0.3]), np.array([0.5, -1.0, 0.3, 1.0, 2.0, -1.5])
HELD_BY_SPRINGS = free_body(
    INERTIA, potential=lambda s: 2.0 * ca.sumsqr(s.pose[:3, 3]) + 0.5 * s.pose[0, 3] ** 4 + 9.81 * s.pose[2, 1]
)
SPRINGS = Case(HELD_BY_SPRINGS, PLACED, THROWN, np.zeros(4))
FLOATING = Case(free_body(INERTIA), PLACED, THROWN, np.zeros(4))


def reference(case: Case, duration: float) -> np.ndarray:
    """DOP853 on the entries of the matrix, from the Euler-Poincare equations written out in numpy."""
    system = case.system
    group, size, dim = system.group.numeric, system.group.size, system.group.dim
    n, metric = size**2, INERTIA.matrix if dim == 6 else np.diag([1.0, 2.0, 3.0]) if case is FREE else J

    def push(pose: np.ndarray) -> np.ndarray:
        if case in (TOP, POTENTIAL):
            return 9.81 * np.cross(pose[2], PULL)
        if case is not SPRINGS:
            return np.zeros(dim)
        force = pose[:3, :3].T @ -(4.0 * pose[:3, 3] + [2.0 * pose[0, 3] ** 3, 0.0, 0.0])
        return np.concatenate((force, 9.81 * np.cross(pose[2, :3], [0.0, 1.0, 0.0])))

    def rate(_: float, state: np.ndarray) -> np.ndarray:
        pose, xi = state[:n].reshape(size, size).T, state[n : n + dim]
        slope = np.linalg.solve(metric, group.ad(xi).T @ metric @ xi + push(pose))
        carried = np.cross(state[n + dim :], xi) if case is TOP else np.zeros(len(state) - n - dim)
        return np.r_[(pose @ group.hat(xi)).T.ravel(), slope, carried]

    return solve_ivp(rate, (0.0, duration), case.row(), method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]


@pytest.mark.usefixtures("interpreted")
@pytest.mark.parametrize(
    ("method", "case", "order"),
    [
        (moser_veselov, FREE, 2),
        (moser_veselov, TOP, 2),
        (discrete_euler_poincare, TOP, 2),
        (discrete_euler_poincare, POTENTIAL, 2),
        (discrete_euler_poincare, FLOATING, 2),
        (discrete_euler_poincare, SPRINGS, 2),
        (munthe_kaas, SPRINGS, 4),
        (matrix_runge_kutta, TOP, 4),
        (projected_runge_kutta, TOP, 4),
        (projected_runge_kutta, SPRINGS, 4),
    ],
)
def test_order_is_the_slope_of_the_error(method: Method, case: Case, order: int) -> None:
    truth = reference(case, 0.5)
    errors = [np.linalg.norm(last(case.run(method, 0.5 / n, 0.5)) - truth) for n in (64, 128)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.1)


def test_fine_steps_reach_the_reference_to_1e_9() -> None:
    for case in (TOP, SPRINGS):
        np.testing.assert_allclose(last(case.run(munthe_kaas, 1e-4, 0.5)), reference(case, 0.5), rtol=0, atol=1e-9)


@pytest.mark.parametrize("method", [moser_veselov, discrete_euler_poincare])
def test_an_advected_direction_and_a_potential_give_one_motion(method: Method) -> None:
    """Bobenko and Suris: the discrete semidirect product is the discrete equation with the potential."""
    advected, potential = TOP.run(method, 0.01, 2.0), POTENTIAL.run(method, 0.01, 2.0)
    np.testing.assert_allclose(advected.poses, potential.poses, rtol=0, atol=1e-12)
    np.testing.assert_allclose(advected.advected, advected.poses[:, 2], rtol=0, atol=1e-13)


def test_the_discrete_momentum_of_moser_and_veselov() -> None:
    """Their equation itself, M+ = W M W^T, W = F^T, h M = F J_d - J_d F^T, on two successive steps."""
    motion, inertia = FREE.run(moser_veselov, 0.3, 0.9), np.diag([1.0, 2.0, 3.0])
    f0, f1 = (motion.poses[k].T @ motion.poses[k + 1] for k in (0, 1))
    half = np.trace(inertia) / 2 * np.eye(3) - inertia
    before, after = (f @ half - half @ f.T for f in (f0, f1))
    np.testing.assert_allclose(after, f0.T @ before @ f0, rtol=0, atol=1e-14)
    np.testing.assert_allclose(so3.hat(inertia @ motion.velocities[1]) * 0.3, after, rtol=0, atol=1e-14)


SYMMETRIC = [(moser_veselov, TOP), (discrete_euler_poincare, SPRINGS)]


@pytest.mark.parametrize(("method", "case"), SYMMETRIC)
def test_a_step_back_undoes_a_step(method: Method, case: Case) -> None:
    start, step, classic = case.row(), method(case.system), munthe_kaas(case.system)
    np.testing.assert_allclose(case.step(step, case.step(step, start, 0.05), -0.05), start, rtol=0, atol=1e-13)
    assert np.abs(case.step(classic, case.step(classic, start, 0.05), -0.05) - start).max() > 1e-10


def symplectic_defect(function: ca.Function, case: Case, h: float) -> float:
    """|D^T Omega(mu+) D - Omega(mu)| for the canonical form on the left-trivialised cotangent bundle.

    -d theta (u, w) = deta . w_mu ... with theta = mu . eta: Omega = [[mu.[.,.], I], [-I, 0]] (Abraham and Marsden).
    """
    system = case.system
    group, numeric, n, size = system.group.symbolic, system.group.numeric, system.group.dim, system.group.size
    metric = INERTIA.matrix if n == 6 else J
    eta, delta = ca.SX.sym("eta", n), ca.SX.sym("delta", n)
    pose = group.compose(ca.SX(case.pose), group.exp(eta))
    advected = system.carry(ca.SX(case.advected), eta)
    varied = ca.vertcat(ca.vec(pose), case.velocity + np.linalg.inv(metric) @ delta, advected)
    x_next = function(0.0, h, varied, system.parameters)
    base = case.step(function, case.row(), h)[: size * size].reshape(size, size).T
    moved = group.log(numeric.inverse(numeric.exp(numeric.log(base))) @ ca.reshape(x_next[: size * size], size, size))
    out = ca.vertcat(moved, metric @ x_next[size * size : size * size + n])
    jacobian = ca.Function("D", [eta, delta], [ca.jacobian(out, ca.vertcat(eta, delta)), out[n:]])
    slope, after = (value.full() for value in jacobian(np.zeros(n), np.zeros(n)))

    def form(momentum: np.ndarray) -> np.ndarray:
        bracket = np.column_stack([numeric.ad(e).T @ momentum for e in np.eye(n)]).T  # [i, j] = mu . [e_i, e_j]
        return np.block([[bracket, np.eye(n)], [-np.eye(n), np.zeros((n, n))]])

    return float(np.abs(slope.T @ form(after.ravel()) @ slope - form(metric @ case.velocity)).max())


@pytest.mark.parametrize(("method", "case"), SYMMETRIC)
def test_variational_steps_are_symplectic(method: Method, case: Case) -> None:
    assert symplectic_defect(method(case.system), case, 0.05) < 1e-11
    assert symplectic_defect(munthe_kaas(case.system), case, 0.05) > 1e-8


def test_spatial_momentum_is_kept_on_se3_with_the_origin_off_the_centre_of_mass() -> None:
    momentum = FLOATING.system.noether_momenta(FLOATING.run(discrete_euler_poincare, 0.05, 100.0))
    # The angular part is about the world's origin, from which the body flies away.
    np.testing.assert_allclose(momentum, np.tile(momentum[0], (len(momentum), 1)), rtol=0, atol=1e-11)
    classic = FLOATING.system.noether_momenta(FLOATING.run(munthe_kaas, 0.05, 100.0))
    assert np.abs(classic - classic[0]).max() > 1e-6


@pytest.mark.parametrize("method", [moser_veselov, discrete_euler_poincare])
def test_under_gravity_the_energy_error_is_bounded_and_of_second_order(method: Method) -> None:
    # Lagrange's top: its motion is quasi-periodic, so that the bound of the first hundred seconds holds for all.
    top = heavy_top(np.diag([0.5, 0.5, 0.3]), np.array([0.0, 0.0, 0.3]))
    tilt, errors = so3.exp([0.4, 0.2, 0.0]), {}
    for h in (0.01, 0.02):
        motion = top.simulate(tilt, SPIN, tilt.T @ UP, step=h, steps=round(1000 / h), method=method)
        energy = top.energies(motion)
        errors[h] = np.abs(energy - energy[0])
        vertical = top.noether_momenta(motion)[:, 2]
        assert np.abs(vertical - vertical[0]).max() < 1e-10  # the symmetry that gravity leaves
        tenth = len(energy) // 10
        assert errors[h][-tenth:].max() < 1.05 * errors[h][:tenth].max()
    assert errors[0.02].max() / errors[0.01].max() == pytest.approx(4.0, rel=0.05)


PUSHED = torque_free_body(J, body_force=lambda s: ca.DM([0.1, 0.0, 0.0]))
QUARTIC = EulerPoincare("quartic", SO3, lambda s: ca.sumsqr(s.velocity) + ca.sumsqr(s.velocity) ** 2)
GYROSTAT = EulerPoincare("gyrostat", SO3, lambda s: ca.sumsqr(s.velocity) + s.velocity[0])


@pytest.mark.parametrize(
    ("call", "argument"),
    [
        (lambda: moser_veselov(FLOATING.system), "system"),
        (lambda: moser_veselov(PUSHED), "system"),
        (lambda: discrete_euler_poincare(QUARTIC), "system"),
        (lambda: discrete_euler_poincare(GYROSTAT), "system"),
    ],
)
def test_bad_input_is_named(call: Callable[[], object], argument: str) -> None:
    with pytest.raises(InputError) as caught:
        call()
    assert caught.value.argument == argument
