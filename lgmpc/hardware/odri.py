"""Robots of the Open Dynamic Robot Initiative (Solo12) by `odri_control_interface`, which is installed beside lgmpc.

That library opens the link to the master board, waits for the motors, calibrates the joints, watches their limits, and
damps them after an error or when the link is lost. Drives on the motor boards close the loop of a command's gains.
"""

from importlib import import_module
from pathlib import Path
from time import perf_counter, sleep
from typing import Any

import numpy as np

from lgmpc.control.interface import Command, Measurement
from lgmpc.errors import InputError, LgmpcError
from lgmpc.typing import Array


class OdriDriver:
    """A :class:`lgmpc.hardware.Driver` of an ODRI robot, clocked by this machine: the robot has no clock.

    The constructor calibrates the joints, and moves them to a posture: hang the robot up.

    Args:
        file: the library's YAML file of the robot; its joint modules are in the order of the robot's joints, and its
            IMU in the axes of the base.
        posture: (nu,) joint positions after the calibration, rad.
        period: time between two measurements, s.

    Raises:
        InputError: the library or the file is not there, or the robot has another number of motors.
        LgmpcError: the robot does not become ready, or its calibration fails.
    """

    def __init__(self, file: str | Path, posture: Array, period: float) -> None:
        try:
            odri: Any = import_module("libodri_control_interface_pywrap")
        except ImportError as error:
            remedy = "the package odri_control_interface, built with its Python bindings, on PYTHONPATH"
            raise InputError("driver", "odri", remedy) from error
        if not Path(file).is_file():
            raise InputError("interface", file, "the YAML file of an ODRI robot, such as config_solo12.yaml")
        self._robot = robot = odri.robot_from_yaml_file(str(file))
        self._joints, motors = robot.joints, len(robot.joints.positions)
        if motors != len(posture):
            raise InputError("interface", f"{file} with {motors} motors", f"one with {len(posture)}")
        try:
            robot.initialize(np.array(posture, dtype=np.float64))
        except RuntimeError as error:
            raise LgmpcError(f"the robot of {file} is not ready: {error}") from error
        self._period, self._begun = period, perf_counter()
        self._next = self._begun

    def read(self, timeout_s: float) -> list[Measurement]:
        """Return the measurement of this period, when it is due; periods that are over without one are skipped.

        Raises:
            LgmpcError: the robot reports an error.
        """
        left = self._next - perf_counter()
        sleep(max(min(left, timeout_s), 0.0))
        if left > timeout_s:
            return []
        self._next += self._period * (1 + int((perf_counter() - self._next) / self._period))
        robot, joints, imu = self._robot, self._joints, self._robot.imu
        robot.parse_sensor_data()
        if robot.has_error:
            lost = "the link to its master board is lost" if robot.is_timeout else "a joint's limit, a motor or the IMU"
            raise LgmpcError(f"the robot reports an error: {lost}")
        return [
            Measurement(
                perf_counter() - self._begun,
                imu.gyroscope.copy(),
                imu.accelerometer.copy(),
                joints.positions.copy(),
                joints.velocities.copy(),
                joints.measured_torques.copy(),
                attitude=imu.attitude_quaternion.copy(),
            )
        ]

    def write(self, command: Command) -> None:
        """Send torques, desired positions and velocities, and gains to the motor boards."""
        joints = self._joints
        joints.set_torques(command.tau)
        joints.set_desired_positions(command.q_des)
        joints.set_desired_velocities(command.v_des)
        joints.set_position_gains(command.kp)
        joints.set_velocity_gains(command.kd)
        self._robot.send_command()

    def close(self) -> None:
        """Release the robot: without commands, its master board switches the motors off."""
        self._joints.set_zero_commands()
        del self._robot, self._joints
