"""Table 4.9.1, evaluated, and against Pinocchio's classes; exercise H.1 in three ways."""

from __future__ import annotations

import featherstone as f
import numpy as np
import pinocchio as pin
import pytest
from example_robot_data import load

from lgmpc.errors import InputError
from lgmpc.mechanics.multibody.articulated import ArticulatedBody

RNG = np.random.default_rng(5)
PLACEMENT = pin.exp6(np.array([0.3, -1.2, 0.7, 0.5, -1.1, 0.8]))
MASS, COM = 2.3, np.array([0.1, -0.2, 0.05])
INERTIA = PLACEMENT.rotation @ np.diag([0.3, 0.5, 0.7]) @ PLACEMENT.rotation.T
XI = RNG.normal(size=6)


def test_both_sides_of_the_table_agree() -> None:
    lines = f.correspondences(PLACEMENT.homogeneous, XI, MASS, COM, INERTIA)
    assert len({line.featherstone for line in lines}) == 6
    for line in lines:
        assert line.error < 1e-13, line.featherstone
        assert np.abs(line.left).max() > 0.1


def test_pinocchio_sides_with_both() -> None:
    motion, other = pin.Motion(XI), pin.Motion(RNG.normal(size=6))
    force = pin.Force(RNG.normal(size=6))
    inertia = pin.Inertia(MASS, COM, INERTIA)
    v = f.swap(XI)
    assert np.allclose(f.swap(f.motion_transform(PLACEMENT.homogeneous)) @ XI, PLACEMENT.actInv(motion).vector)
    assert np.allclose(f.swap(f.force_transform(PLACEMENT.homogeneous)) @ force.vector, PLACEMENT.actInv(force).vector)
    assert np.allclose(f.swap(f.motion_cross(v)) @ other.vector, motion.cross(other).vector)
    assert np.allclose(f.swap(f.force_cross(v)) @ force.vector, motion.cross(force).vector)
    assert np.allclose(f.swap(f.spatial_inertia(MASS, COM, INERTIA)), inertia.matrix())
    assert np.allclose(
        f.swap(f.force_cross(v) @ f.spatial_inertia(MASS, COM, INERTIA) @ v), inertia.vxiv(motion).vector
    )


def test_the_force_transform_is_the_inverse_transpose() -> None:
    x, dual = f.motion_transform(PLACEMENT.homogeneous), f.force_transform(PLACEMENT.homogeneous)
    assert np.allclose(dual, np.linalg.inv(x).T, atol=1e-13)
    # A Plucker transform is not orthogonal, but it keeps the two invariant forms of se(3) (exercise 3 of 4.9).
    assert np.abs(x.T @ x - np.eye(6)).max() > 0.1
    klein = np.block([[np.zeros((3, 3)), np.eye(3)], [np.eye(3), np.zeros((3, 3))]])
    killing = np.diag([-4.0, -4.0, -4.0, 0.0, 0.0, 0.0])
    assert np.allclose(x.T @ klein @ x, klein, atol=1e-13)
    assert np.allclose(x.T @ killing @ x, killing, atol=1e-13)


def test_crosses_are_rates_of_transforms() -> None:
    step = 1e-6
    v = f.swap(XI)
    ahead, behind = (pin.exp6(s * step * XI).homogeneous for s in (1, -1))
    motion = (f.motion_transform(behind) - f.motion_transform(ahead)) / (2 * step)
    force = (f.force_transform(behind) - f.force_transform(ahead)) / (2 * step)
    assert np.allclose(motion, f.motion_cross(v), atol=1e-8)
    assert np.allclose(force, f.force_cross(v), atol=1e-8)


def test_torques_of_a_wrench_in_three_ways() -> None:
    """Exercise H.1 on a seven-joint arm: Jacobian transpose, RNEA with an external force, back by hand."""
    model = load("talos_arm").model
    data = model.createData()
    q, zero = RNG.uniform(-2.0, 2.0, 7), np.zeros(7)
    wrench = RNG.normal(size=6)
    tip = model.njoints - 1
    transpose = pin.computeJointJacobian(model, data, q, tip).T @ wrench
    external = pin.StdVec_Force()
    external.extend([pin.Force.Zero()] * model.njoints)
    external[tip] = pin.Force(wrench)
    statics = pin.rnea(model, data, q, zero, zero) - pin.rnea(model, data, q, zero, zero, external)
    by_hand = f.static_torques(ArticulatedBody.from_model(model), q, len(zero) - 1, wrench)
    assert np.abs(transpose).max() > 0.1
    assert np.allclose(statics, transpose, atol=1e-12)
    assert np.allclose(by_hand, transpose, atol=1e-12)


def test_a_wrench_on_an_inner_link_loads_no_outer_joint() -> None:
    body = ArticulatedBody.from_model(load("talos_arm").model)
    torques = f.static_torques(body, np.full(7, 0.3), 3, np.ones(6))
    assert np.all(torques[4:] == 0) and np.all(torques[:4] != 0)


def test_bad_input_is_refused() -> None:
    body = ArticulatedBody.from_model(load("talos_arm").model)
    with pytest.raises(InputError, match="link: got 7; expected 0 to 6"):
        f.static_torques(body, np.zeros(7), 7, np.zeros(6))
    with pytest.raises(InputError, match="wrench"):
        f.static_torques(body, np.zeros(7), 6, np.zeros(3))
    with pytest.raises(InputError, match="mass: got -1"):
        f.spatial_inertia(-1.0, COM, INERTIA)
    with pytest.raises(InputError, match="a positive definite matrix"):
        f.spatial_inertia(1.0, COM, np.diag([1.0, 1.0, -1.0]))
    with pytest.raises(InputError, match="symmetric"):
        f.spatial_inertia(1.0, COM, INERTIA + np.triu(np.ones((3, 3)), 1))
    for transform in (f.motion_transform, f.force_transform):
        with pytest.raises(InputError, match="placement"):
            transform(2.0 * np.eye(4))
    for product in (f.motion_cross, f.force_cross):
        with pytest.raises(InputError, match="v: got shape"):
            product(np.zeros(3))
    with pytest.raises(InputError, match="xi"):
        f.correspondences(PLACEMENT.homogeneous, np.full(6, np.nan), MASS, COM, INERTIA)
    with pytest.raises(InputError, match="value"):
        f.swap(np.zeros(5))
