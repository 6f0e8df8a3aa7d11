"""The limits of a robot's joints and of its simulated drives, for certificates and explanations."""

from __future__ import annotations

from lgmpc.robot import Robot
from lgmpc.runs.limited import DriveLine, JointLimits
from lgmpc.simulation.drives import ActuatorSettings

__all__ = ["joint_limits"]


def joint_limits(robot: Robot, drives: ActuatorSettings) -> JointLimits:
    """Return the limits of joints that a log does not contain.

    Args:
        robot: the robot, with limits of position and speed.
        drives: settings of its drives, with or without a torque-speed line.
    """
    stall, no_load = drives.stall_torque_nm, drives.no_load_speed_rad_s
    line = None if stall is None or no_load is None else DriveLine(stall, no_load)
    return JointLimits(robot.joint_lower, robot.joint_upper, robot.velocity_limit, line)
