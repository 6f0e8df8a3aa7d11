from __future__ import annotations

import time
from collections.abc import Callable

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

from lgmpc.errors import InputError
from lgmpc.lie import se3, so3
from lgmpc.mechanics.variational import (
    GroupSystem,
    compare_integrators,
    discrete_euler_poincare,
    drift_table,
    heavy_top_system,
    lie_runge_kutta,
    matrix_runge_kutta,
    moser_veselov,
    simulate,
)

FREE = GroupSystem(np.diag([1.0, 2.0, 3.0]))
FREE_START = FREE.start(np.eye(3), [1.0, 0.0, 0.8])

TOP = heavy_top_system([[0.5, 0.02, 0.0], [0.02, 0.4, 0.01], [0.0, 0.01, 0.3]], 9.81, [0.02, -0.05, 0.3])
TOP_START = TOP.start(so3.exp([0.4, 0.2, 0.0]), [0.3, -0.2, 6.0])

INERTIA = pin.Inertia(1.5, np.array([0.1, 0.05, -0.02]), np.diag([0.1, 0.2, 0.25])).matrix()
SPRINGS = GroupSystem(INERTIA, lambda g: 2.0 * ca.sumsqr(g[:3, 3]) + 0.5 * g[0, 3] ** 4 + 9.81 * g[2, 1])
FLOATING = GroupSystem(INERTIA)
FLOATING_START = FLOATING.start(se3.exp([0.3, -0.2, 0.1, 0.5, 0.1, -0.3]), [0.5, -1.0, 0.3, 1.0, 2.0, -1.5])

Make = Callable[[GroupSystem], ca.Function]


def reference(system: GroupSystem, start: np.ndarray, duration: float) -> np.ndarray:
    """DOP853 on the entries of the matrix, from the Euler-Poincare equations written out in numpy."""
    x = ca.SX.sym("x", system.nx)
    g, mu = system.split(x)
    force = ca.Function("force", [x], [system.force(g, system.velocity(mu))])
    group = so3 if system.nv == 3 else se3
    n = system.size**2

    def rate(_: float, state: np.ndarray) -> np.ndarray:
        element, momentum = state[:n].reshape(system.size, system.size).T, state[n:]
        xi = np.linalg.solve(system.inertia, momentum)
        push = group.ad(xi).T @ momentum + force(state).full().ravel()
        return np.r_[(element @ group.hat(xi)).T.ravel(), push]

    return solve_ivp(rate, (0.0, duration), start, method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]


@pytest.mark.parametrize(
    ("make", "system", "start", "order"),
    [
        (moser_veselov, FREE, FREE_START, 2),
        (moser_veselov, TOP, TOP_START, 2),
        (discrete_euler_poincare, TOP, TOP_START, 2),
        (discrete_euler_poincare, FLOATING, FLOATING_START, 2),
        (discrete_euler_poincare, SPRINGS, FLOATING_START, 2),
        (lie_runge_kutta, TOP, TOP_START, 4),
        (lie_runge_kutta, SPRINGS, FLOATING_START, 4),
        (matrix_runge_kutta, TOP, TOP_START, 4),
    ],
)
def test_order_is_the_slope_of_the_error(make: Make, system: GroupSystem, start: np.ndarray, order: int) -> None:
    truth, step = reference(system, start, 0.5), make(system)
    errors = [np.linalg.norm(simulate(step, system, start, 0.5 / n, 0.5).states[-1] - truth) for n in (32, 64)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.1)


def test_fine_steps_reach_the_reference_to_1e_9() -> None:
    for system, start in ((TOP, TOP_START), (SPRINGS, FLOATING_START)):
        found = simulate(lie_runge_kutta(system), system, start, 1e-4, 0.5).states[-1]
        np.testing.assert_allclose(found, reference(system, start, 0.5), rtol=0, atol=1e-9)


def test_the_discrete_momentum_of_moser_and_veselov() -> None:
    """Their equation itself, M+ = W M W^T, W = F^T, h M = F J_d - J_d F^T, on two successive steps."""
    motion = simulate(moser_veselov(FREE), FREE, FREE_START, 0.3, 0.9)
    f0, f1 = (motion.elements[k].T @ motion.elements[k + 1] for k in (0, 1))
    half = np.trace(FREE.inertia) / 2 * np.eye(3) - FREE.inertia
    before, after = (f @ half - half @ f.T for f in (f0, f1))
    np.testing.assert_allclose(after, f0.T @ before @ f0, rtol=0, atol=1e-14)
    np.testing.assert_allclose(so3.hat(motion.momenta[1]) * 0.3, after, rtol=0, atol=1e-14)


@pytest.mark.parametrize(
    ("make", "system", "start"),
    [(moser_veselov, TOP, TOP_START), (discrete_euler_poincare, SPRINGS, FLOATING_START)],
)
def test_a_step_back_undoes_a_step(make: Make, system: GroupSystem, start: np.ndarray) -> None:
    step = make(system)
    back = step(step(start, 0.05), -0.05).full().ravel()
    np.testing.assert_allclose(back, start, rtol=0, atol=1e-13)
    classic = lie_runge_kutta(system)
    assert np.abs(classic(classic(start, 0.05), -0.05).full().ravel() - start).max() > 1e-10


def symplectic_defect(step: ca.Function, system: GroupSystem, start: np.ndarray, h: float) -> float:
    """|D^T Omega(mu+) D - Omega(mu)| for the canonical form on the left-trivialised cotangent bundle.

    -d theta (u, w) = deta . w_mu ... with theta = mu . eta: Omega = [[mu.[.,.], I], [-I, 0]] (Abraham and Marsden).
    """
    group, n = system.group, system.nv
    eta, delta = ca.SX.sym("eta", n), ca.SX.sym("delta", n)
    g, mu = (part.full() for part in system.split(ca.DM(start)))
    varied = system.join(group.compose(ca.SX(g), group.exp(eta)), mu + delta)
    g_next, mu_next = system.split(step(varied, h))
    base = system.split(step(start, h))[0]
    out = ca.vertcat(group.log(group.compose(ca.SX(group.inverse(base)), g_next)), mu_next)
    jacobian = ca.Function("D", [eta, delta], [ca.jacobian(out, ca.vertcat(eta, delta)), mu_next])
    slope, after = (value.full() for value in jacobian(np.zeros(n), np.zeros(n)))

    def form(momentum: np.ndarray) -> np.ndarray:
        numeric = so3 if n == 3 else se3
        bracket = np.column_stack([numeric.ad(e).T @ momentum for e in np.eye(n)]).T  # [i, j] = mu . [e_i, e_j]
        return np.block([[bracket, np.eye(n)], [-np.eye(n), np.zeros((n, n))]])

    return float(np.abs(slope.T @ form(after.ravel()) @ slope - form(mu.ravel())).max())


@pytest.mark.parametrize(
    ("make", "system", "start"),
    [(moser_veselov, TOP, TOP_START), (discrete_euler_poincare, SPRINGS, FLOATING_START)],
)
def test_variational_steps_are_symplectic(make: Make, system: GroupSystem, start: np.ndarray) -> None:
    assert symplectic_defect(make(system), system, start, 0.05) < 1e-11
    assert symplectic_defect(lie_runge_kutta(system), system, start, 0.05) > 1e-8


def test_spatial_momentum_is_kept_on_se3_with_the_origin_off_the_centre_of_mass() -> None:
    motion = simulate(discrete_euler_poincare(FLOATING), FLOATING, FLOATING_START, 0.05, 100.0)
    momentum = motion.spatial_momentum()
    # The angular part is about the world's origin, from which the body flies away.
    np.testing.assert_allclose(momentum, np.tile(momentum[0], (len(momentum), 1)), rtol=0, atol=1e-11)
    classic = simulate(matrix_runge_kutta(FLOATING), FLOATING, FLOATING_START, 0.05, 100.0).spatial_momentum()
    assert np.abs(classic - classic[0]).max() > 1e-6


def test_the_1000_s_comparison_gives_the_known_figures_in_time() -> None:
    begun = time.perf_counter()
    drifts = {h: compare_integrators(FREE, FREE_START, h, 1000.0) for h in (0.1, 0.2)}
    assert time.perf_counter() - begun < 10.0
    plain, projected, euler_poincare, moser = drifts[0.1]
    # Chapter 4.14.2, errata: RK4 loses 1.24e-5 at h = 0.1, 3.9e-4 at h = 0.2, with or without projection.
    for drift in (plain, projected):
        assert drift.energy[-1] == pytest.approx(-1.24e-5, rel=0.01)
    assert drifts[0.2][0].energy[-1] == pytest.approx(-3.9e-4, rel=0.01)
    ratio = drifts[0.2][0].energy[-1] / plain.energy[-1]
    assert np.log2(ratio) == pytest.approx(5.0, abs=0.1)
    assert plain.orthogonality[-1] > 1e-4 and projected.orthogonality.max() < 1e-14
    assert np.abs(moser.energy).max() < 1e-11 and moser.momentum.max() < 1e-11 and moser.orthogonality.max() < 1e-11
    # The exponential's discrete energy differs by a bounded O(h^2), its momentum not at all.
    assert euler_poincare.momentum.max() < 1e-11
    bounds = [np.abs(drifts[h][2].energy) for h in (0.1, 0.2)]
    assert bounds[1].max() / bounds[0].max() == pytest.approx(4.0, rel=0.05)
    assert bounds[0][-2000:].max() < 1.01 * bounds[0][:2000].max()
    assert "discrete Moser-Veselov" in drift_table(drifts[0.1])


@pytest.mark.parametrize("make", [moser_veselov, discrete_euler_poincare])
def test_under_gravity_the_energy_error_is_bounded_and_of_second_order(make: Make) -> None:
    # Lagrange's top: its motion is quasi-periodic, so that the bound of the first hundred seconds holds for all.
    top = heavy_top_system(np.diag([0.5, 0.5, 0.3]), 9.81, [0.0, 0.0, 0.3])
    start = top.start(so3.exp([0.4, 0.2, 0.0]), [0.3, -0.2, 6.0])
    step, errors = make(top), {}
    for h in (0.01, 0.02):
        motion = simulate(step, top, start, h, 1000.0)
        errors[h] = np.abs(motion.energy() - motion.energy()[0])
        vertical = motion.spatial_momentum()[:, 2]
        assert np.abs(vertical - vertical[0]).max() < 1e-10  # the symmetry that gravity leaves
        tenth = len(errors[h]) // 10
        assert errors[h][-tenth:].max() < 1.05 * errors[h][:tenth].max()
    assert errors[0.02].max() / errors[0.01].max() == pytest.approx(4.0, rel=0.05)


@pytest.mark.parametrize(
    ("call", "argument"),
    [
        (lambda: GroupSystem(np.diag([1.0, 2.0, -3.0])), "inertia"),
        (lambda: GroupSystem(np.eye(4)), "inertia"),
        (lambda: GroupSystem([[1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), "inertia"),
        (lambda: GroupSystem(np.diag([1.0, np.nan, 3.0])), "inertia"),
        (lambda: FREE.start(np.diag([1.0, 1.0, -1.0]), np.zeros(3)), "element"),
        (lambda: FREE.start(np.eye(3), np.zeros(4)), "velocity"),
        (lambda: heavy_top_system(np.eye(3), np.inf, np.zeros(3)), "weight"),
        (lambda: simulate(moser_veselov(FREE), FREE, FREE_START, 0.0, 1.0), "h"),
        (lambda: simulate(moser_veselov(FREE), FREE, FREE_START, 0.1, -1.0), "duration"),
        (lambda: simulate(moser_veselov(FREE), FREE, FREE_START[:-1], 0.1, 1.0), "start"),
        (lambda: moser_veselov(FLOATING), "system"),
        (lambda: compare_integrators(FLOATING, FLOATING_START, 0.1, 1.0), "system"),
    ],
)
def test_bad_input_is_named(call: Callable[[], object], argument: str) -> None:
    with pytest.raises(InputError) as caught:
        call()
    assert caught.value.argument == argument
