"""Solo12 as the configs have it, and states and references to try the whole-body QP on."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.robot import Robot, RobotSpec, load_robot
from lgmpc.wbc import WholeBodyReference, WholeBodyTerms

RandomState = Callable[[np.random.Generator], tuple[np.ndarray, np.ndarray]]


@pytest.fixture(scope="session")
def solo12() -> Robot:
    return load_robot(
        RobotSpec(
            model="solo12",
            contact_frames=("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT"),
            contact_radius_m=0.016,
            posture={"*_HAA": 0.0, "F?_HFE": 0.8, "F?_KFE": -1.6, "H?_HFE": -0.8, "H?_KFE": 1.6},
            effort_limit_nm=1.8,
            velocity_limit_rad_s=30.0,
            position_limit_rad={"*_HAA": (-0.9, 0.9), "*_HFE": (-1.45, 1.45), "*_KFE": (-2.8, 2.8)},
            armature_kg_m2=3.6e-4,
        )
    )


@pytest.fixture(scope="session")
def random_state(solo12: Robot) -> RandomState:
    """A tilted, moving state around the reference posture, somewhere in the world."""

    def draw(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        step = np.concatenate([rng.normal(0, 1, 3), rng.normal(0, 0.2, 3), rng.normal(0, 0.15, solo12.nu)])
        return pin.integrate(solo12.model, solo12.q_reference, step), rng.normal(0, 0.5, solo12.nv)

    return draw


@pytest.fixture
def standing(solo12: Robot) -> WholeBodyReference:
    terms = WholeBodyTerms(solo12)
    return WholeBodyReference.standing(solo12, terms.com, terms.contact_points)


@pytest.fixture(scope="session")
def randomise() -> Callable[[WholeBodyReference, WholeBodyTerms, np.random.Generator], None]:
    """Ask for something that the robot could nearly do at its present state."""

    def write(reference: WholeBodyReference, terms: WholeBodyTerms, rng: np.random.Generator) -> None:
        reference.com[:] = terms.com + rng.normal(0, 0.02, 3)
        reference.com_velocity[:] = rng.normal(0, 0.2, 3)
        reference.com_acceleration[:] = rng.normal(0, 2.0, 3)
        reference.base_rotation[:] = terms.rotation @ pin.exp3(rng.normal(0, 0.2, 3))
        reference.base_angular_velocity[:] = rng.normal(0, 0.3, 3)
        reference.joint_position[:] = terms.q[7:] + rng.normal(0, 0.2, terms.q.size - 7)
        reference.external_wrench[:] = np.concatenate([rng.normal(0, 2.0, 3), rng.normal(0, 0.2, 3)])
        reference.contact_forces[:] = rng.normal((0, 0, 6.0), 1.0, reference.contact_forces.shape)

    return write
