import numpy as np
import pytest

from lgmpc.lie import quaternion, so3
from lgmpc.locomotion.horizon import MotionReference
from lgmpc.mpc import MeasuredState
from lgmpc.mpc.centroidal import CentroidalReference
from lgmpc.timegrid import TimeGrid

MASS, RATE, NODE = 2.5, 3.0, 0.02


def test_the_reference_is_the_motion_and_the_momentum_that_turns_the_base_back() -> None:
    rng = np.random.default_rng(60)
    target = np.zeros((5, 12))
    writer = CentroidalReference(target[:, 1:10], MASS, RATE, TimeGrid(NODE, 4))
    for _ in range(3):
        attitude, theta = rng.normal(0, 0.5, 3), rng.normal(0, 0.5, 3)
        com, velocity, spin = rng.normal(size=(3, 5, 3))
        q = np.tile(np.r_[np.zeros(3), quaternion.exp(attitude), 0.3], (5, 1))
        inertia = np.diag([0.02, 0.05, 0.06]) + 0.003 * rng.normal(size=(3, 3))
        rotation = so3.exp(attitude) @ so3.exp(-theta)
        state = MeasuredState(0.0, np.zeros(0), np.zeros(0), np.zeros(3), np.zeros(6), rotation, inertia)
        writer.write(state, MotionReference(com, velocity, q, spin))
        np.testing.assert_array_equal(target[:, [0, 10, 11]], 0.0)
        np.testing.assert_array_equal(target[:, 1:4], com)
        np.testing.assert_array_equal(target[:, 4:7], MASS * velocity)
        turning = RATE * np.exp(-RATE * NODE * np.arange(5))[:, None] * theta + spin @ rotation
        np.testing.assert_allclose(target[:, 7:10], turning @ inertia.T, atol=1e-14)


@pytest.mark.parametrize("name", ["com", "com_velocity", "angular_velocity"])
def test_a_motion_of_another_length_is_refused(name: str) -> None:
    arrays = {key: np.zeros((5, 3)) for key in ("com", "com_velocity", "angular_velocity")}
    arrays[name] = np.zeros((4, 3))
    state = MeasuredState.centroidal(0.0, np.zeros(3), np.zeros(6))
    with pytest.raises(ValueError, match=r"shape \(4, 3\)"):
        CentroidalReference(np.zeros((5, 9)), MASS, RATE, TimeGrid(NODE, 4)).write(
            state, MotionReference(q=np.tile([0, 0, 0, 0, 0, 0, 1.0], (5, 1)), **arrays)
        )


def test_locked_joints_give_a_turning_robot_the_angular_momentum_of_its_masses() -> None:
    """Point masses on a tilted base: the sum of m r x (w x r), for each of several angular velocities."""
    rng = np.random.default_rng(61)
    masses, spins, rotation = rng.uniform(0.1, 1.0, 7), rng.normal(size=(5, 3)), so3.exp(np.array([0.3, -0.2, 0.7]))
    arms = rng.normal(0.0, 0.2, (7, 3)) @ rotation.T
    inertia = sum(m * (r @ r * np.eye(3) - np.outer(r, r)) for m, r in zip(masses, arms, strict=True))
    state = MeasuredState(0.0, np.zeros(0), np.zeros(0), np.zeros(3), np.zeros(6), rotation, inertia @ rotation)
    moments = np.cross(arms, np.cross(spins[:, None], arms))
    np.testing.assert_allclose(state.angular_momentum(spins), np.einsum("m,nmi->ni", masses, moments), atol=1e-13)
