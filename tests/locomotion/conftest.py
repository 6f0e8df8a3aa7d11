"""The robot whose legs are measured."""

from __future__ import annotations

import pytest

from lgmpc.locomotion.legs import LegGeometry
from lgmpc.robot import Robot, RobotSpec, load_robot


@pytest.fixture(scope="session")
def solo12() -> Robot:
    feet = ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT")
    return load_robot(
        RobotSpec(
            model="solo12",
            contact_frames=feet,
            contact_radius_m=0.016,
            posture="standing",
            effort_limit_nm=1.8,
            velocity_limit_rad_s=30.0,
            position_limit_rad={"*_HAA": (-0.9, 0.9), "*_HFE": (-1.45, 1.45), "*_KFE": (-2.8, 2.8)},
        )
    )


@pytest.fixture(scope="session")
def legs(solo12: Robot) -> LegGeometry:
    return LegGeometry.of(solo12)
