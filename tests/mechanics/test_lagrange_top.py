from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lgmpc.errors import InputError
from lgmpc.lie import quaternion, so3
from lgmpc.mechanics import UP, LagrangeTop, Motion, heavy_top

TOP = LagrangeTop(transverse=0.5, axial=0.3, weight=2.0)


def simulate(top: LagrangeTop, rotation: np.ndarray, velocity: np.ndarray, end: float, step: float = 5e-4) -> Motion:
    steps = 10 * round(end / step / 10)
    return top.system.simulate(rotation, velocity, rotation.T @ UP, step=step, steps=steps, every=10)


@pytest.mark.parametrize("tilt", [0.3, 1.2, math.pi / 2, 2.5])
@pytest.mark.parametrize("spin", [15.0, -12.0])
def test_steady_precession_slow_and_fast(tilt: float, spin: float) -> None:
    for rate in TOP.steady_precession(tilt, spin):
        if not abs(rate) < 100.0:
            continue  # of a horizontal axis there is no fast one
        rotation, velocity = TOP.start(tilt, spin, rate)
        motion = simulate(TOP, rotation, velocity, 2.0, 1e-4)
        axis = motion.poses[:, :, 2]
        turned = np.stack([so3.exp(rate * t * UP) @ axis[0] for t in motion.times])
        np.testing.assert_allclose(axis, turned, atol=1e-8 if abs(rate) > 10 else 1e-9)
        nutation = TOP.nutation(rotation, velocity)
        assert nutation.tilts == pytest.approx((tilt, tilt), abs=1e-9)


def test_slow_precession_of_a_fast_top_is_the_gyroscopes() -> None:
    slow, fast = TOP.steady_precession(0.5, 1e4)
    assert slow == pytest.approx(TOP.weight / (TOP.axial * 1e4), rel=1e-5)
    assert fast == pytest.approx(TOP.axial * 1e4 / (TOP.transverse * math.cos(0.5)), rel=1e-5)


def test_a_slow_top_has_no_steady_precession() -> None:
    slowest = 2 * math.sqrt(TOP.transverse * TOP.weight * math.cos(0.3)) / TOP.axial
    TOP.steady_precession(0.3, slowest * 1.001)
    with pytest.raises(InputError, match=f"spin: .* at least {slowest:.6g}"):
        TOP.steady_precession(0.3, slowest * 0.999)
    with pytest.raises(InputError, match="spin: got 0 rad/s"):
        TOP.steady_precession(2.0, 0.0)


@pytest.mark.parametrize(
    ("rotation", "velocity"),
    [
        (so3.exp([0.3, 0.0, 0.0]), [0.0, 0.0, 15.0]),  # cusps
        (so3.exp([0.3, 0.0, 0.0]), [0.0, -0.5, 15.0]),  # loops
        (so3.exp([0.8, 0.2, 0.5]), [1.0, 2.0, 12.0]),
        (so3.exp([0.8, 0.2, 0.5]), [-1.0, 0.3, -9.0]),
        (so3.exp([2.8, 0.2, 0.0]), [0.5, 0.0, 0.0]),  # a spherical pendulum
    ],
)
def test_nutation_in_closed_form(rotation: np.ndarray, velocity: list[float]) -> None:
    nutation = TOP.nutation(rotation, np.array(velocity))
    motion = simulate(TOP, rotation, np.array(velocity), 3.0, 2e-4)
    np.testing.assert_allclose(nutation.cosines(motion.times), motion.advected[:, 2], atol=1e-9)
    fine = simulate(TOP, rotation, np.array(velocity), 1.2 * nutation.period, 1e-4)
    tilts = np.arccos(fine.advected[:, 2])
    assert nutation.tilts == pytest.approx((tilts.min(), tilts.max()), abs=1e-3 * (tilts.max() - tilts.min()))
    assert tilts.min() >= nutation.tilts[0] - 1e-9
    assert tilts.max() <= nutation.tilts[1] + 1e-9
    np.testing.assert_allclose(nutation.cosines(np.array([0.7])), nutation.cosines(np.array([0.7 + nutation.period])))


@pytest.mark.parametrize(("rotation", "tilt"), [(np.eye(3), 0.0), (np.diag([1.0, -1.0, -1.0]), math.pi)])
def test_a_vertical_axis_stays_vertical(rotation: np.ndarray, tilt: float) -> None:
    assert TOP.nutation(rotation, np.array([0.0, 0.0, 20.0])).tilts == (tilt, tilt)


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_an_upright_top_stays_upright_up_to_its_critical_spin(share: float) -> None:
    """The equilibrium is unstable: it is approached from the separatrix, and all three roots coincide at the end."""
    top = LagrangeTop(1.0, 1.0, 1.0)
    nutation = top.nutation(np.eye(3), np.array([0.0, 0.0, share * top.critical_spin]))
    np.testing.assert_array_equal(nutation.cosines(np.array([0.0, 1.0, 100.0])), 1.0)
    assert nutation.period == math.inf


@pytest.mark.parametrize("ratio", [0.6, 0.9, 0.99, 1.01, 1.2])
def test_sleeping_top_on_both_sides_of_the_critical_spin(ratio: float) -> None:
    spin = ratio * TOP.critical_spin
    disturbance = 1e-4
    rotation, velocity = TOP.start(disturbance, spin, 0.5 * TOP.axial * spin / TOP.transverse)
    nutation = TOP.nutation(rotation, velocity)
    motion = simulate(TOP, rotation, velocity, 1.1 * nutation.period, 5e-4)
    measured = float(np.arctan2(np.linalg.norm(motion.advected[:, :2], axis=1), motion.advected[:, 2]).max())
    assert measured == pytest.approx(nutation.tilts[1], rel=1e-4)
    if ratio > 1.0:
        assert TOP.sleeping_growth(spin) == TOP.fall(spin) == 0.0
        assert measured < 20 * disturbance
    else:
        assert measured == pytest.approx(TOP.fall(spin), rel=1e-2)
        assert TOP.fall(spin) > 0.2


def test_an_unstable_sleeping_top_leaves_the_vertical_at_the_predicted_rate() -> None:
    spin = 0.5 * TOP.critical_spin
    rotation, velocity = TOP.start(1e-7, spin, 0.5 * TOP.axial * spin / TOP.transverse)
    motion = simulate(TOP, rotation, velocity, 6.0, 1e-3)
    tilt = np.linalg.norm(motion.advected[:, :2], axis=1)
    late = (tilt > 1e-5) & (tilt < 1e-3)
    rate = np.polyfit(motion.times[late], np.log(tilt[late]), 1)[0]
    assert late.sum() > 50
    assert rate == pytest.approx(TOP.sleeping_growth(spin), rel=1e-3)


# Inertia and moment about the fixed point, gravity, rotation and velocity at the start.
SIMO_WONG = (
    np.diag([5.0, 5.0, 1.0]),
    np.array([0.0, 0.0, 20.0]),
    1.0,
    so3.exp([0.3, 0.0, 0.0]),
    np.array([0, 0, 50.0]),
)
"""Int. J. Numer. Methods Eng. 31 (1991)."""
BRULS = (
    np.diag([15.234375, 0.46875, 15.234375]),
    np.array([0.0, 15.0, 0.0]),
    9.81,
    np.eye(3),
    np.array([0.0, 150.0, -4.61538]),
)
"""Bruls, Cardona, Arnold, Mechanism and Machine Theory 48 (2012): a fast disc on a horizontal arm."""


@pytest.mark.parametrize(
    ("benchmark", "end", "step"), [(SIMO_WONG, 0.5, 1.25e-4), (BRULS, 0.1, 1.25e-5)], ids=["simo_wong", "bruls"]
)
def test_benchmarks_against_dop853(benchmark, end: float, step: float) -> None:
    inertia, moment, gravity, rotation, velocity = benchmark

    def rate(_: float, y: np.ndarray) -> np.ndarray:
        """Of quaternion and body angular velocity."""
        x, w = y[:4], y[4:]
        torque = np.cross(inertia @ w, w) + gravity * np.cross(quaternion.to_matrix(x / np.linalg.norm(x))[2], moment)
        turn = np.r_[x[3] * w + np.cross(x[:3], w), -x[:3] @ w]
        return np.r_[turn / 2, np.linalg.solve(inertia, torque)]

    start = np.r_[quaternion.from_matrix(rotation), velocity]
    truth = solve_ivp(rate, (0.0, end), start, "DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    turned = quaternion.to_matrix(truth[:4] / np.linalg.norm(truth[:4]))

    def run(steps: int) -> Motion:
        system = heavy_top(inertia, moment, gravity)
        return system.simulate(rotation, velocity, rotation.T @ UP, step=end / steps, steps=steps, every=steps)

    steps = round(end / step)
    motion = run(steps)
    np.testing.assert_allclose(motion.poses[-1], turned, atol=1e-9)
    np.testing.assert_allclose(motion.velocities[-1], truth[4:], atol=1e-9)
    errors = [np.linalg.norm(run(n).poses[-1] - turned) for n in (steps // 10, steps // 20)]
    assert np.log2(errors[1] / errors[0]) == pytest.approx(4.0, abs=0.4)


def test_nutation_of_the_simo_wong_top_in_closed_form() -> None:
    top = LagrangeTop(5.0, 1.0, 20.0)
    rotation, velocity = SIMO_WONG[3:]
    motion = top.system.simulate(rotation, velocity, rotation.T @ UP, step=1.25e-4, steps=80000, every=80)
    np.testing.assert_allclose(motion.advected[:, 2], top.nutation(rotation, velocity).cosines(motion.times), atol=1e-9)
    energies = top.system.energies(motion)
    np.testing.assert_allclose(energies, energies[0], rtol=1e-10)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((0.5, 0.3, 0.0), "weight: got 0.0"),
        ((0.0, 0.3, 1.0), "transverse: got 0.0"),
        ((0.5, -0.3, 1.0), "axial: got -0.3"),
        ((0.5, 1.2, 1.0), "axial: .*triangle"),
        ((0.5, math.nan, 1.0), "axial: .* finite"),
    ],
)
def test_impossible_tops_are_refused(arguments: tuple[float, float, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        LagrangeTop(*arguments)


def test_bad_states_are_refused() -> None:
    with pytest.raises(InputError, match="rotation: .* a rotation"):
        TOP.nutation(2 * np.eye(3), np.ones(3))
    with pytest.raises(InputError, match="velocity: got shape"):
        TOP.nutation(np.eye(3), np.ones(2))
