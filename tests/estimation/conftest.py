"""Solo12, for tests that require legs."""

from __future__ import annotations

import pytest

from lgmpc.robot import Robot, RobotSpec, load_robot


@pytest.fixture(scope="session")
def solo12() -> Robot:
    spec = RobotSpec(
        model="solo12",
        contact_frames=("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT"),
        contact_radius_m=0.016,
        effort_limit_nm=1.8,
        velocity_limit_rad_s=30.0,
        position_limit_rad=(-3.0, 3.0),
        posture={"*_HAA": 0.0, "F?_HFE": 0.8, "F?_KFE": -1.6, "H?_HFE": -0.8, "H?_KFE": 1.6},
    )
    return load_robot(spec)
