from __future__ import annotations

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

from lgmpc.errors import InputError
from lgmpc.lie import se3, so3
from lgmpc.mechanics import HEIGHT, SpatialInertia, check_inertia, free_body, heavy_top, torque_free_body

BODY = SpatialInertia(
    1.5, np.array([0.1, 0.05, -0.2]), np.array([[0.1, 0.01, 0], [0.01, 0.2, -0.02], [0, -0.02, 0.25]])
)
WRENCH = np.array([1.0, -2.0, 3.0, 0.1, 0.2, -0.1])


def pinocchio_body(gravity: float) -> tuple[pin.Model, pin.Data]:
    model = pin.Model()
    root = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root")
    model.appendBodyToJoint(root, pin.Inertia(BODY.mass, BODY.center, BODY.rotational), pin.SE3.Identity())
    model.gravity = pin.Motion(np.array([0.0, 0.0, -gravity, 0.0, 0.0, 0.0]))
    return model, model.createData()


def test_spatial_inertia_is_pinocchios() -> None:
    inertia = pin.Inertia(BODY.mass, BODY.center, BODY.rotational)
    np.testing.assert_allclose(BODY.matrix, inertia.matrix(), atol=1e-15)
    np.testing.assert_allclose(BODY.about_origin, inertia.matrix()[3:, 3:], atol=1e-15)


@pytest.mark.parametrize("gravity", [0.0, 9.81])
def test_acceleration_is_that_of_pinocchios_free_flyer(gravity: float) -> None:
    """Body frame's origin away from the centre of mass."""
    model, data = pinocchio_body(gravity)
    system = free_body(BODY, gravity, body_force=lambda s: ca.DM(WRENCH))
    rng = np.random.default_rng(0)
    for _ in range(20):
        q, v = pin.randomConfiguration(model, -np.ones(7), np.ones(7)), rng.normal(size=6)
        g = pin.XYZQUATToSE3(q).homogeneous
        ours = system.acceleration(0.0, g, v, g.T @ HEIGHT, system.parameters).full().ravel()
        np.testing.assert_allclose(ours, pin.aba(model, data, q, v, WRENCH), rtol=1e-12, atol=1e-11)


def test_motion_is_that_of_pinocchio_integrated_by_dop853() -> None:
    model, data = pinocchio_body(9.81)
    q0 = np.r_[0.3, -0.2, 0.1, 0.0, 0.0, 0.0, 1.0]
    v0 = np.r_[0.5, -1.0, 0.3, 1.0, 2.0, -1.5]

    def field(_: float, y: np.ndarray) -> np.ndarray:
        x, v = y[:7].copy(), y[7:]
        x[3:] /= np.linalg.norm(x[3:])
        acceleration = pin.aba(model, data, x, v, WRENCH)
        rotation = pin.Quaternion(x[3:]).matrix()
        quaternion = pin.Quaternion(x[3:]) * pin.Quaternion(np.r_[v[3:] / 2, 0.0])
        return np.r_[rotation @ v[:3], quaternion.coeffs(), acceleration]

    truth = solve_ivp(field, (0.0, 1.0), np.r_[q0, v0], method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    start = pin.XYZQUATToSE3(q0).homogeneous
    system = free_body(BODY, 9.81, body_force=lambda s: ca.DM(WRENCH))
    motion = system.simulate(start, v0, start.T @ HEIGHT, step=1e-3, steps=1000, every=1000)
    truth[3:7] /= np.linalg.norm(truth[3:7])
    np.testing.assert_allclose(motion.poses[-1], pin.XYZQUATToSE3(truth[:7]).homogeneous, atol=1e-9)
    np.testing.assert_allclose(motion.velocities[-1], truth[7:], atol=1e-9)


def test_centre_of_mass_falls_on_a_parabola_and_heights_are_carried() -> None:
    system = free_body(BODY, 9.81)
    v0 = np.r_[0.5, -1.0, 0.3, 1.0, 2.0, -1.5]
    motion = system.simulate(np.eye(4), v0, HEIGHT, step=1e-3, steps=2000, every=50)
    center = se3.act(motion.poses, BODY.center)
    start = v0[:3] + np.cross(v0[3:], BODY.center)
    t = motion.times[:, None]
    np.testing.assert_allclose(center, BODY.center + t * start - 9.81 / 2 * t**2 * [0, 0, 1], atol=1e-9)
    np.testing.assert_allclose(motion.advected, np.swapaxes(motion.poses, 1, 2) @ HEIGHT, atol=1e-11)
    np.testing.assert_allclose(system.energies(motion), system.energies(motion)[0], atol=1e-9)


def test_constant_spatial_torque_grows_the_spatial_momentum() -> None:
    torque = np.array([0.1, -0.2, 0.3])
    system = torque_free_body(BODY.rotational, body_force=lambda s: s.pose.T @ ca.DM(torque))
    motion = system.simulate(so3.exp([0.1, 0.2, 0.3]), [1.0, -1.0, 0.5], step=1e-3, steps=1000, every=10)
    momenta = system.noether_momenta(motion)
    np.testing.assert_allclose(momenta, momenta[0] + motion.times[:, None] * torque, atol=1e-10)


@pytest.mark.parametrize(
    ("inertia", "message"),
    [
        (np.diag([1.0, 1.0, 0.0]), "inertia: got eigenvalues 0, 1, 1; expected a positive definite matrix"),
        (np.diag([1.0, 1.0, -0.5]), "inertia: .* positive definite"),
        (np.diag([1.0, 1.0, 2.5]), "inertia: got principal moments 1, 1, 2.5; expected no .*triangle"),
        (np.eye(3) + np.triu(np.ones((3, 3)), 1) * 0.1, "inertia: .* symmetric"),
        (np.eye(2), "inertia: got shape"),
        (np.tile(np.eye(3), (2, 1, 1)), "inertia: got shape"),
        (np.diag([1.0, np.nan, 1.0]), "inertia: .* finite"),
        ("heavy", "inertia: got 'heavy'; expected numbers"),
    ],
)
def test_inertias_that_no_body_has_are_refused(inertia: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        torque_free_body(inertia)  # type: ignore[arg-type]


def test_a_flat_plate_is_a_body() -> None:
    plate = np.diag([1.0, 2.0, 3.0])
    turn = so3.exp([0.3, 0.7, -0.2])
    np.testing.assert_array_equal(check_inertia("inertia", turn @ plate @ turn.T), turn @ plate @ turn.T)


@pytest.mark.parametrize(
    ("mass", "center", "message"),
    [(0.0, np.zeros(3), "mass: got 0.0"), (np.nan, np.zeros(3), "mass"), (1.0, np.zeros(2), "center: got shape")],
)
def test_bodies_without_mass_or_with_half_a_centre_are_refused(mass: float, center: np.ndarray, message: str) -> None:
    with pytest.raises(InputError, match=message):
        SpatialInertia(mass, center, np.eye(3))


def test_weights_that_cannot_be_are_refused() -> None:
    with pytest.raises(InputError, match=r"moment: got shape \(2,\)"):
        heavy_top(np.eye(3), np.ones(2))
    with pytest.raises(InputError, match=r"gravity: got shape \(3,\)"):
        heavy_top(np.eye(3), np.ones(3), [0.0, 0.0, -9.81])  # type: ignore[arg-type]
    with pytest.raises(InputError, match="gravity: .* finite"):
        free_body(BODY, np.nan)
