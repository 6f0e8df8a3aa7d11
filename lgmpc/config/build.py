"""From a config to the objects it describes. The only file that knows every room."""

from __future__ import annotations

from collections.abc import Mapping

from lgmpc.config.schema import Config
from lgmpc.errors import ConfigError, ConfigErrors, InputError
from lgmpc.robot import Robot, RobotSpec, load_robot
from lgmpc.runs import Gate

__all__ = ["build_gate", "build_robot", "build_robot_spec"]

_ROBOT_KEYS = {
    "effort_limit": "robot.effort_limit_nm",
    "velocity_limit": "robot.velocity_limit_rad_s",
    "position_limit": "robot.position_limit_rad",
    "armature": "robot.armature_kg_m2",
    "contact_radius": "robot.contact_radius_m",
}


def build_robot_spec(config: Config) -> RobotSpec:
    """Return what section ``robot`` says, in the words of :func:`lgmpc.robot.load_robot`."""
    robot = config.robot
    posture = robot.posture
    return RobotSpec(
        model=robot.model,
        urdf=robot.urdf,
        srdf=robot.srdf,
        package_dirs=robot.package_dirs,
        floating_base=robot.floating_base,
        contact_frames=robot.contact_frames,
        contact_radius=robot.contact_radius_m,
        posture=dict(posture) if isinstance(posture, Mapping) else posture,
        effort_limit=robot.effort_limit_nm,
        velocity_limit=robot.velocity_limit_rad_s,
        position_limit=robot.position_limit_rad,
        armature=robot.armature_kg_m2,
    )


def build_robot(config: Config) -> Robot:
    """Load the robot and check that the rest of the config fits it.

    Raises:
        ConfigError: if the robot does not exist, or a push names a body that it does not have.
        ModelError: with everything that the model lacks.
    """
    try:
        robot = load_robot(build_robot_spec(config))
    except InputError as error:
        key = _ROBOT_KEYS.get(error.argument, f"robot.{error.argument}")
        raise config.error(key, error.got, error.expected, error.choices) from error
    found = [
        config.error(f"pushes.{i}.body", push.body, "a body of the robot", robot.bodies)
        for i, push in enumerate(config.pushes)
        if push.body not in robot.bodies
    ]
    if found:
        raise _together(found)
    return robot


def build_gate(config: Config) -> Gate:
    """Return the limits of section ``gate``."""
    return Gate(**config.gate.model_dump())


def _together(found: list[ConfigError]) -> ConfigError:
    return found[0] if len(found) == 1 else ConfigErrors(found)
