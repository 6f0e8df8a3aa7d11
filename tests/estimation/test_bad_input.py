"""Arguments of a wrong type, shape or value are one error that names them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from lgmpc.errors import InputError
from lgmpc.estimation import (
    ContactDetector,
    DelaySettings,
    FrictionMonitor,
    InvariantEkf,
    JointFrictionEstimator,
    LeggedEstimator,
    LegSensing,
    StatePredictor,
    WrenchObserver,
)
from lgmpc.estimation.inertial import error_dynamics, exponential_increment, gravity_increment
from lgmpc.robot import Robot, RobotSpec, Sphere, load_robot, place_shape

pytestmark = pytest.mark.usefixtures("interpreted")
WRONG = (None, "a", float("nan"), np.zeros((2, 5)), [1, "x"], object())
ZERO = np.zeros(3)


def calls(robot: Robot) -> Iterator[tuple[Callable[..., Any], dict[str, Any]]]:
    """Callables with valid arguments, of which none has None as a valid value."""
    yield WrenchObserver, {"period": 1e-3, "time_constant": 0.01, "force_limit": 3.0, "delay": 0.0, "noise_force": 1.0}
    yield StatePredictor, {"robot": robot, "period": 1e-3, "delays": DelaySettings(command_s=0.002)}
    yield JointFrictionEstimator, {"robot": robot, "period": 1e-3}
    yield FrictionMonitor, {"nominal": 0.6, "period": 1e-3}
    yield LeggedEstimator, {"robot": robot, "period": 1e-3}
    yield LegSensing, {"robot": robot, "period": 1e-3, "encoder_noise": 1e-3, "foot_noise": 1e-3}
    yield ContactDetector, {"feet": 4, "touch_force": 3.0, "release_force": 1.0}
    yield (InvariantEkf, {"contacts": 1, "slip": 0.01, "contact_offset": ZERO, "outlier_probability": 0.1})
    yield exponential_increment, {"gyro": ZERO, "accelerometer": ZERO, "duration": 0.1}
    yield gravity_increment, {"gravity": ZERO, "duration": 0.1, "columns": 2}
    yield error_dynamics, {"gravity": ZERO, "columns": 2}
    yield place_shape, {"model": robot.model, "shape": Sphere(link="FL_FOOT", radius_m=0.1)}
    yield robot.frame, {"name": "FL_FOOT"}
    yield robot.body_frame, {"name": "base_link"}
    ekf = InvariantEkf(1)
    ekf.begin_contact(0, ZERO, np.eye(3))
    yield ekf.predict, {"gyro": ZERO, "accelerometer": ZERO, "duration": 0.01}
    yield ekf.correct_height, {"foot": 0, "height": 0.0, "deviation": 0.1}


def test_arguments_of_a_wrong_type_are_named() -> None:
    feet = ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT")
    robot = load_robot(RobotSpec(model="solo12", contact_frames=feet, effort_limit_nm=1.8, velocity_limit_rad_s=30.0))
    for call, valid in calls(robot):
        call(**valid)
        for name in valid:
            for wrong in WRONG:
                with pytest.raises(InputError) as caught:
                    call(**{**valid, name: wrong})
                assert caught.value.argument in (name, "body", "frame"), (call, name, wrong)


@pytest.mark.parametrize("wrong", [3, "left", None])
def test_a_form_is_one_of_three(wrong: Any) -> None:
    with pytest.raises(InputError, match="form: got .*; expected RIGHT, LEFT or MULTIPLICATIVE"):
        InvariantEkf(1, form=wrong)
