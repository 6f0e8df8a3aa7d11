from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.special import ellipj

from lgmpc.errors import InputError
from lgmpc.lie import so3
from lgmpc.mechanics import EulerTop, torque_free_body
from lgmpc.mechanics.elliptic import Modulus

TURN = so3.exp([0.3, -0.8, 0.5])
START = so3.exp([0.4, -0.3, 0.9])
MOMENTS = {"unequal": (1.0, 2.0, 2.7), "flat": (1.0, 2.0, 3.0), "oblate": (1.0, 1.0, 1.5), "prolate": (1.0, 1.5, 1.5)}
SPINS = {
    "around the longest moment": (0.3, 0.2, 1.0),
    "around the shortest": (-1.2, 0.3, -0.2),
    "between": (0.5, 1.0, 0.4),
}


def top(moments: str, spin: str) -> EulerTop:
    """A body whose principal axes are not its frame's."""
    return EulerTop(TURN @ np.diag(MOMENTS[moments]) @ TURN.T, TURN @ SPINS[spin], START)


@pytest.mark.parametrize("spin", SPINS)
@pytest.mark.parametrize("moments", MOMENTS)
def test_closed_form_is_the_integrated_motion(moments: str, spin: str) -> None:
    exact = top(moments, spin)
    motion = torque_free_body(exact.inertia).simulate(START, exact.velocity, step=1e-3, steps=20000, every=200)
    np.testing.assert_allclose(exact.velocities(motion.times), motion.velocities, atol=1e-10)


def test_closed_form_solves_eulers_equations_for_dop853_too() -> None:
    exact = top("unequal", "between")

    def field(_: float, w: np.ndarray) -> np.ndarray:
        return np.linalg.solve(exact.inertia, np.cross(exact.inertia @ w, w))

    truth = solve_ivp(field, (0.0, 10.0), exact.velocity, method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    np.testing.assert_allclose(exact.velocities(np.array([10.0]))[0], truth, atol=1e-11)


@pytest.mark.parametrize("spin", SPINS)
@pytest.mark.parametrize("moments", MOMENTS)
def test_invariants_hold_at_any_time(moments: str, spin: str) -> None:
    exact = top(moments, spin)
    times = np.array([-5.0, 0.0, 0.3, 17.0, 1e3, 1e5])
    velocities = exact.velocities(times)
    np.testing.assert_allclose(
        0.5 * np.einsum("ni,ij,nj->n", velocities, exact.inertia, velocities), exact.energy, rtol=1e-12
    )
    np.testing.assert_allclose(np.linalg.norm(velocities @ exact.inertia, axis=1), exact.momentum, rtol=1e-12)
    np.testing.assert_allclose(velocities[1], exact.velocity, atol=1e-14)


@pytest.mark.parametrize("spin", SPINS)
@pytest.mark.parametrize("moments", ["unequal", "flat"])
def test_period_and_montgomerys_phase(moments: str, spin: str) -> None:
    """After one period the velocity is back, and the body has turned about its momentum by Montgomery's angle.

    ``2 E T / L - Omega``, Omega the solid angle that the body momentum encloses (Am. J. Phys. 59, 1991), by quadrature.
    """
    exact = top(moments, spin)
    one = np.array([exact.period])
    velocities = exact.velocities(np.arange(2000) * exact.period / 2000)
    unit, solution = velocities @ exact.inertia / exact.momentum, exact._solution
    pole = solution.axes[:, 2] * math.copysign(1.0, solution.amplitudes[2])  # the axis that the momentum circles
    swept = np.cross(unit, np.cross(unit, velocities)) @ pole / (1.0 + unit @ pole)  # (1 - cos colatitude) d longitude
    angle = exact.period * (2.0 * exact.energy / exact.momentum - swept.mean())
    np.testing.assert_allclose(exact.velocities(one)[0], exact.velocity, atol=1e-11)
    axis, body = START @ exact.inertia @ exact.velocity / exact.momentum, torque_free_body(exact.inertia)
    turned = body.simulate(START, exact.velocity, step=exact.period / 20000, steps=20000, every=20000).poses[-1]
    np.testing.assert_allclose(turned @ START.T, so3.exp(angle * axis), atol=1e-10)


def test_flips_of_the_middle_axis_are_half_a_period_apart() -> None:
    """Dzhanibekov: measured as the zero crossings of a numerical integration."""
    exact = EulerTop(np.diag([1.0, 2.0, 3.0]), [0.01, 1.5, 0.01])

    def field(_: float, w: np.ndarray) -> np.ndarray:
        return np.cross([1.0, 2.0, 3.0] * w, w) / [1.0, 2.0, 3.0]

    crossing = lambda _, w: w[1]  # noqa: E731
    found = solve_ivp(
        field, (0.0, 60.0), exact.velocity, method="DOP853", rtol=1e-13, atol=1e-15, events=crossing
    ).t_events[0]
    flips = exact.flips(60.0)
    assert len(flips) >= 4
    np.testing.assert_allclose(flips, found, atol=1e-7)  # what dop853's energy error makes of it, times 1 / (1 - m)
    np.testing.assert_allclose(np.diff(flips), exact.flip_interval, rtol=1e-12)
    np.testing.assert_allclose(exact.velocities(flips)[:, 1], 0.0, atol=1e-12)


def test_separatrix_has_no_period() -> None:
    exact = EulerTop(np.diag([1.0, 2.0, 3.0]), [1.0, 1.0, math.sqrt(1.0 / 3.0)])
    times = np.linspace(0.0, 5.0, 11)
    motion = torque_free_body(exact.inertia).simulate(np.eye(3), exact.velocity, step=1e-3, steps=5000, every=500)
    np.testing.assert_allclose(exact.velocities(times), motion.velocities, atol=1e-9)
    assert exact.period == math.inf or exact.period > 50.0


def test_steady_rotation_has_no_period() -> None:
    steady = EulerTop(np.diag([1.0, 2.0, 3.0]), [0.0, 2.0, 0.0], START)
    times = np.array([0.0, 1.0, 100.0])
    np.testing.assert_array_equal(steady.velocities(times), [[0.0, 2.0, 0.0]] * 3)
    with pytest.raises(InputError, match="velocity: .* steady"):
        steady.period  # noqa: B018
    assert EulerTop(np.eye(3), [1.0, 2.0, 3.0]).steady


def test_symmetric_top_precession() -> None:
    """Landau and Lifshitz, "Mechanics", 36: of the velocity about the body's axis."""
    transverse, axial, w = 1.0, 1.5, np.array([0.3, 0.1, 2.0])
    exact = EulerTop(np.diag([transverse, transverse, axial]), w)
    body = (axial - transverse) / transverse * w[2]
    times = np.linspace(0.0, 5.0, 51)
    velocities = exact.velocities(times)
    angle = np.unwrap(np.arctan2(velocities[:, 1], velocities[:, 0]))
    np.testing.assert_allclose(angle - angle[0], body * times, atol=1e-11)
    assert exact.period == pytest.approx(2 * math.pi / abs(body), rel=1e-12)


@pytest.mark.parametrize("m1", [1.0, 0.3, 1e-3, 1e-9, 1e-16])
def test_elliptic_functions_against_quadrature(m1: float) -> None:
    """Each u is the integral that defines it, over the Gudermannian of the amplitude, which removes its peak."""
    modulus = Modulus(1.0 - m1, m1)

    def integral(amplitude: float) -> float:
        # x = gd(s): dx = dx/ds ds with cos x = 1 / cosh s, smooth however small m1 is.
        def integrand(s: float) -> float:
            cosine = 1.0 / math.cosh(s)
            return cosine / math.sqrt(m1 + modulus.m * cosine**2)

        end = math.asinh(math.tan(amplitude))
        return quad(integrand, 0.0, end, epsabs=1e-13, epsrel=1e-13, limit=400)[0]

    for amplitude in (-1.2, 0.0, 0.7, 1.5, 1.57, 1.570796):
        u = modulus.first_kind(math.sin(amplitude), math.cos(amplitude))
        assert u == pytest.approx(integral(amplitude), rel=1e-10, abs=1e-13)
        sn, cn, dn = modulus.jacobi(np.array(u))
        assert float(sn) == pytest.approx(math.sin(amplitude), abs=1e-12)
        assert float(cn) == pytest.approx(math.cos(amplitude), rel=1e-7, abs=1e-12)
        assert float(dn) == pytest.approx(math.sqrt(m1 + modulus.m * math.cos(amplitude) ** 2), rel=1e-7)


@pytest.mark.parametrize("m1", [1.0, 0.3, 1e-3, 1e-9])
def test_elliptic_functions_are_periodic(m1: float) -> None:
    modulus = Modulus(1.0 - m1, m1)
    k = modulus.quarter_period
    u = np.linspace(-0.99 * k, 0.99 * k, 21)
    for turns in (-3, 1, 2):
        moved = modulus.jacobi(u + 2 * turns * k)
        for value, here, sign in zip(moved, modulus.jacobi(u), ((-1) ** turns, (-1) ** turns, 1), strict=True):
            np.testing.assert_allclose(value, sign * here, atol=1e-12)
    for amplitude in (2.0, -2.5, 3.1):
        sn, cn, _ = modulus.jacobi(np.array(modulus.first_kind(math.sin(amplitude), math.cos(amplitude))))
        np.testing.assert_allclose([sn, cn], [math.sin(amplitude), math.cos(amplitude)], atol=1e-12)


def test_the_separatrix_is_valid_for_arguments_of_any_size() -> None:
    sn, cn, dn = Modulus(1.0, 0.0).jacobi(np.array([-np.inf, -1e3, 0.0, 1e3, np.inf]))
    np.testing.assert_array_equal(sn, [-1.0, -1.0, 0.0, 1.0, 1.0])
    np.testing.assert_array_equal(cn, [0.0, 0.0, 1.0, 0.0, 0.0])
    np.testing.assert_array_equal(dn, cn)


def test_elliptic_functions_are_scipys_where_those_are_good() -> None:
    u = np.linspace(-30.0, 30.0, 301)
    for m in (0.0, 0.2, 0.9):
        np.testing.assert_allclose(Modulus(m, 1.0 - m).jacobi(u), ellipj(u, m)[:3], atol=1e-13)
    np.testing.assert_allclose(Modulus(1.0, 0.0).jacobi(u), [np.tanh(u), 1 / np.cosh(u), 1 / np.cosh(u)], atol=1e-15)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("tilt", [1e-2, 1e-5, 1e-8])
def test_nearly_steady_rotations(axis: int, tilt: float) -> None:
    """Errors grow only by the instability of the middle axis."""
    velocity = tilt * np.array([0.6, 0.5, -0.7])
    velocity[axis] = 1.0
    exact = EulerTop(np.diag([1.0, 1.6, 2.1]), velocity, START)
    motion = torque_free_body(exact.inertia).simulate(START, velocity, step=1e-3, steps=5000, every=500)
    np.testing.assert_allclose(exact.velocities(motion.times), motion.velocities, atol=1e-9)


def test_a_motion_does_not_follow_later_changes_of_the_callers_arrays() -> None:
    velocity = np.array([1.0, 0.2, 0.3])
    exact = EulerTop(np.diag([1.0, 2.0, 3.0]), velocity)
    period = exact.period
    velocity *= 2.0
    np.testing.assert_allclose(exact.velocities(np.array([0.0, period])), 2 * [[1.0, 0.2, 0.3]], atol=1e-12)
    assert exact.momentum == pytest.approx(np.linalg.norm([1.0, 0.4, 0.9]), rel=1e-15)
    with pytest.raises(ValueError, match="read-only"):
        exact.velocity[0] = 2.0


def test_bad_input_is_named() -> None:
    with pytest.raises(InputError, match="inertia: .*triangle"):
        EulerTop(np.diag([1.0, 1.0, 3.0]), [1.0, 0.0, 0.0])
    with pytest.raises(InputError, match="velocity: got zero"):
        EulerTop(np.eye(3), [0.0, 0.0, 0.0])
    with pytest.raises(InputError, match="velocity: got shape"):
        EulerTop(np.eye(3), [1.0, 0.0])
    with pytest.raises(InputError, match="rotation: .* a rotation"):
        EulerTop(np.eye(3), [1.0, 0.0, 0.0], 2 * np.eye(3))
    with pytest.raises(InputError, match="times: got shape"):
        top("flat", "between").velocities(np.zeros((2, 2)))
