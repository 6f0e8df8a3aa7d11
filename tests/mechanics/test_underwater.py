from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import ellipk

from lgmpc.errors import InputError
from lgmpc.lie import se3, so3
from lgmpc.mechanics.integrators import discrete_euler_poincare
from lgmpc.mechanics.rigid_body import SpatialInertia
from lgmpc.mechanics.underwater import UnderwaterVehicle, spheroid_added_mass

BODY = SpatialInertia(11.5, np.array([0.02, -0.01, -0.05]), np.diag([0.16, 0.2, 0.25]))
FULL = np.diag([5.5, 12.7, 14.6, 0.12, 0.13, 0.14]) + 0.05 * np.ones((6, 6))
VEHICLE = UnderwaterVehicle(
    BODY, FULL, [4.0, 6.2, 5.2, 0.07, 0.08, 0.09], [18.2, 21.7, 37.0, 1.5, 1.6, 1.7], 115.0, [0.0, 0.01, 0.03]
)


def torpedo(**more: Any) -> UnderwaterVehicle:
    """A neutral spheroid, 1.6 m by 0.2 m, its mass spread as the water's it displaces."""
    a, b = 0.8, 0.1
    mass = 4 / 3 * np.pi * 1000.0 * a * b**2
    inertia = mass / 5 * np.diag([2 * b**2, a**2 + b**2, a**2 + b**2])
    body = SpatialInertia(mass, np.zeros(3), inertia)
    return UnderwaterVehicle(body, spheroid_added_mass(1.6, 0.2), buoyancy=mass * 9.81, **more)


def linearised(vehicle: UnderwaterVehicle, velocity: list[float]) -> np.ndarray:
    """The Jacobian of nu' by nu in the pose of the world."""
    system = vehicle.system()
    s = system.symbols()
    slope = system.function("slope", s, slope=ca.jacobian(system.acceleration(*s.arguments), s.velocity))
    return slope(0.0, np.eye(4), velocity, [], system.parameters).full()


def fossen(vehicle: UnderwaterVehicle, rotation: np.ndarray, nu: np.ndarray) -> np.ndarray:
    """``nu'`` by Fossen (2011), theorem 3.2 and 6: ``M nu' + C(nu) nu + D(nu) nu + g(eta) = 0``."""
    linear, angular = np.split(vehicle.mass_matrix @ nu, 2)
    coriolis = np.block([[np.zeros((3, 3)), -so3.hat(linear)], [-so3.hat(linear), -so3.hat(angular)]])
    np.testing.assert_allclose(coriolis @ nu, se3.force_cross(nu) @ vehicle.mass_matrix @ nu, rtol=0, atol=1e-13)
    damping = vehicle.linear_damping + np.diag(vehicle.quadratic_damping * np.abs(nu))
    lever, up = vehicle.weight * vehicle.body.center - vehicle.buoyancy * vehicle.center_of_buoyancy, rotation[2]
    restoring = np.r_[(vehicle.weight - vehicle.buoyancy) * up, np.cross(lever, up)]
    return np.linalg.solve(vehicle.mass_matrix, -(coriolis + damping) @ nu - restoring)


def test_the_system_has_the_accelerations_of_fossens_equation() -> None:
    system, rng = VEHICLE.system(), np.random.default_rng(2)
    for _ in range(5):
        pose, nu = se3.exp(rng.normal(size=6)), rng.normal(size=6)
        found = system.acceleration(0.0, pose, nu, np.zeros(0), system.parameters).full().ravel()
        np.testing.assert_allclose(found, fossen(VEHICLE, pose[:3, :3], nu), rtol=0, atol=1e-12)


def test_casimirs_of_kirchhoffs_equations_are_kept_without_damping() -> None:
    mass = BODY.mass
    body = SpatialInertia(mass, np.zeros(3), BODY.rotational)
    vehicle = UnderwaterVehicle(body, FULL, buoyancy=mass * 9.81)  # neutral, centres together
    system = vehicle.system()
    start = np.array([0.8, 0.1, -0.2, 0.3, 0.5, -0.4])
    motion = system.simulate(np.eye(4), start, step=0.02, steps=10_000, method=discrete_euler_poincare)
    p, angular = np.hsplit(system.momenta(motion), 2)
    norm, helicity = np.linalg.norm(p, axis=1), np.einsum("ni,ni->n", p, angular)
    np.testing.assert_allclose(norm, norm[0], rtol=1e-12)
    np.testing.assert_allclose(helicity, helicity[0], rtol=0, atol=1e-11)
    assert np.abs(p - p[0]).max() > 1.0  # each component for itself is not
    energy = system.energies(motion)
    assert np.abs(energy / energy[0] - 1).max() < 2e-3
    damped = UnderwaterVehicle(body, FULL, 4.0 * np.ones(6), buoyancy=mass * 9.81).system()
    slowed = damped.momenta(damped.simulate(np.eye(4), start, step=0.02, steps=250, method=discrete_euler_poincare))
    assert np.linalg.norm(slowed[-1, :3]) < 0.9 * norm[0]


@pytest.mark.usefixtures("interpreted")
def test_damping_leaves_the_order_of_the_variational_integrator_at_two() -> None:
    system = VEHICLE.system(lambda s: ca.DM([30.0, 5.0, 0.0, 1.0, 0.5, 2.0]))
    start = se3.exp([0, 0, 0, 0.4, -0.3, 0.2]), np.array([0.8, 0.1, 0.2, 0.3, 0.5, 0.4])
    truth = system.simulate(*start, step=1e-4, steps=2000)
    errors = []
    for steps in (20, 40):
        found = system.simulate(*start, step=0.2 / steps, steps=steps, method=discrete_euler_poincare)
        errors.append(
            np.linalg.norm(
                np.r_[(found.poses - truth.poses[-1])[-1].ravel(), found.velocities[-1] - truth.velocities[-1]]
            )
        )
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.1)


@pytest.mark.usefixtures("interpreted")
def test_munk_instability_grows_at_the_linearised_rate() -> None:
    vehicle, speed = torpedo(), 1.5
    m1, m2, inertia = vehicle.mass_matrix[0, 0], vehicle.mass_matrix[1, 1], vehicle.mass_matrix[5, 5]
    growth = speed * np.sqrt(m1 * (m2 - m1) / (m2 * inertia))
    eigenvalues = np.linalg.eigvals(linearised(vehicle, [speed, 0, 0, 0, 0, 0]))
    assert eigenvalues.real.max() == pytest.approx(growth, rel=1e-12)

    system = vehicle.system()
    # Along the growing mode: m2 v' = -m1 U r.
    tiny = 1e-7
    start = np.array([speed, tiny, 0, 0, 0, -growth * m2 * tiny / (m1 * speed)])
    motion = system.simulate(np.eye(4), start, step=6e-3 / growth, steps=1000)
    drift = np.log(motion.velocities[:, 1] / tiny)
    assert drift[-1] / motion.times[-1] == pytest.approx(growth, rel=1e-4)


def test_translation_broadside_on_is_stable() -> None:
    eigenvalues = np.linalg.eigvals(linearised(torpedo(), [0, 1.5, 0, 0, 0, 0]))
    assert eigenvalues.real.max() < 1e-7


@pytest.mark.parametrize(("linear", "quadratic"), [(4.0, 20.0), (0.0, 20.0), (4.0, 0.0)])
def test_a_sinking_vehicle_follows_the_closed_form(linear: float, quadratic: float) -> None:
    body = SpatialInertia(12.0, np.array([0.0, 0.0, -0.04]), BODY.rotational)
    vehicle = UnderwaterVehicle(
        body, [5, 6, 14.0, 0.1, 0.1, 0.1], linear * np.ones(6), quadratic * np.ones(6), 100.0, [0.0, 0.0, 0.02]
    )
    motion = vehicle.system().simulate(np.eye(4), np.zeros(6), step=1e-3, steps=10_000)
    force = 12.0 * 9.81 - 100.0
    root = np.sqrt(linear**2 + 4.0 * quadratic * force)  # 26 v' = force - linear v - quadratic v^2
    decay = np.exp(-root / 26.0 * motion.times)
    expected = 2.0 * force / (linear + root) * (1.0 - decay) / (1.0 + (root - linear) / (root + linear) * decay)
    np.testing.assert_allclose(-motion.velocities[:, 2], expected, rtol=0, atol=1e-9)


def test_a_righting_vehicle_swings_as_a_pendulum() -> None:
    body = SpatialInertia(12.0, np.zeros(3), BODY.rotational)
    weight, height, swing = 12.0 * 9.81, 0.05, 1.2
    vehicle = UnderwaterVehicle(body, [5, 6, 14.0, 0.1, 0.1, 0.1], buoyancy=weight, center_of_buoyancy=[0, 0, height])
    system = vehicle.system()
    omega = np.sqrt(weight * height / (BODY.rotational[0, 0] + 0.1))
    period = 4 * ellipk(np.sin(swing / 2) ** 2) / omega
    start = se3.from_parts(so3.exp([swing, 0, 0]), np.zeros(3))
    motion = system.simulate(start, np.zeros(6), step=period / 4000, steps=4000)
    np.testing.assert_allclose(motion.poses[-1], start, rtol=0, atol=1e-9)
    np.testing.assert_allclose(motion.velocities[-1], 0.0, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("slenderness", "along", "across", "turning"),
    [(1.5, 0.305, 0.621, 0.094), (2.0, 0.209, 0.702, 0.240), (6.01, 0.045, 0.918, 0.764), (9.97, 0.021, 0.960, 0.883)],
)
def test_added_mass_of_spheroids_is_lambs_table(
    slenderness: float, along: float, across: float, turning: float
) -> None:
    """Lamb (1932), art. 115: inertia coefficients k1, k2, k', computed by hand: two of his three digits are correct."""
    a, b = slenderness, 1.0
    displaced = 4 / 3 * np.pi * a * b**2
    added = spheroid_added_mass(2 * a, 2 * b, density=1.0)
    found = np.array([added[0], added[1], added[5] / ((a**2 + b**2) / 5)]) / displaced
    np.testing.assert_allclose(found, [along, across, turning], rtol=0, atol=2.5e-3)


def test_added_mass_of_spheroids_is_that_of_the_potential_integrals() -> None:
    """Lamb's alpha and beta as he defines them, by quadrature."""
    a, b = 1.7, 0.6

    def integral(c: float) -> float:
        return a * b**2 * quad(lambda t: 1 / ((c**2 + t) * np.sqrt(a**2 + t) * (b**2 + t)), 0, np.inf, epsabs=1e-13)[0]

    alpha, beta, displaced = integral(a), integral(b), 4 / 3 * np.pi * a * b**2 * 1025.0
    expected = displaced * np.array([alpha / (2 - alpha), beta / (2 - beta)])
    np.testing.assert_allclose(spheroid_added_mass(2 * a, 2 * b, 1025.0)[:2], expected, rtol=1e-10)


def test_a_nearly_round_spheroid_drags_half_the_water_it_displaces() -> None:
    added = spheroid_added_mass(2.002, 2.0, density=1.0) / (4 / 3 * np.pi)
    np.testing.assert_allclose(added[:3], 0.5, atol=2e-3)
    assert abs(added[5]) < 1e-5
    nearer = spheroid_added_mass(2.0 + 2e-9, 2.0, density=1.0) / (4 / 3 * np.pi)
    np.testing.assert_allclose(nearer[:3], 0.5, atol=2e-9)


@pytest.mark.parametrize(
    ("call", "argument"),
    [
        (lambda: UnderwaterVehicle(BODY, np.eye(5)), "added_mass"),
        (lambda: UnderwaterVehicle(BODY, -np.ones(6)), "added_mass"),
        (lambda: UnderwaterVehicle(BODY, np.triu(np.ones((6, 6)))), "added_mass"),
        (lambda: UnderwaterVehicle(BODY, linear_damping=-np.ones(6)), "linear_damping"),
        (lambda: UnderwaterVehicle(BODY, quadratic_damping=[-1.0, 0, 0, 0, 0, 0]), "quadratic_damping"),
        (lambda: UnderwaterVehicle(BODY, buoyancy=-1.0), "buoyancy"),
        (lambda: UnderwaterVehicle(BODY, center_of_buoyancy=[0.0, np.nan, 0.0]), "center_of_buoyancy"),
        (lambda: spheroid_added_mass(1.0, 1.0), "diameter"),
    ],
)
def test_bad_input_is_named(call: Callable[[], object], argument: str) -> None:
    with pytest.raises(InputError) as caught:
        call()
    assert caught.value.argument == argument
