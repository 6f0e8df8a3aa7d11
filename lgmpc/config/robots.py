"""From section ``robot`` of a config to a checked robot that the rest of the config fits."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

from lgmpc.config.schema import Config, Document
from lgmpc.errors import ConfigError, ConfigErrors, InputError, ModelError
from lgmpc.robot import Robot, RobotSpec, load_robot

__all__ = ["build_any_robot", "build_robot", "build_robot_spec"]

_ROBOT_KEYS = {
    "model, urdf": "robot.model",
    "effort_limit": "robot.effort_limit_nm",
    "velocity_limit": "robot.velocity_limit_rad_s",
    "position_limit": "robot.position_limit_rad",
    "armature": "robot.armature_kg_m2",
    "contact_radius": "robot.contact_radius_m",
    "contact_frames": "robot.contact_frames",
    "posture": "robot.posture",
}
"""What the arguments of :class:`RobotSpec` are called in a config."""


def build_robot_spec(config: Document) -> RobotSpec:
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


def build_any_robot(config: Document) -> Robot:
    """Load the robot, whatever kind of robot it is.

    Raises:
        ConfigError: if the robot does not exist.
        ModelError: with everything that the model lacks.
    """
    try:
        return load_robot(build_robot_spec(config))
    except InputError as error:
        key = _ROBOT_KEYS.get(error.argument, f"robot.{error.argument}")
        raise config.error(key, error.got, error.expected, error.choices) from error
    except ModelError as error:
        raise ModelError(error.robot, [_in_words_of_a_config(problem) for problem in error.problems]) from error


def build_robot(config: Config) -> Robot:
    """Load the robot of a closed loop and check that the rest of the config fits it.

    Raises:
        ConfigError: if the robot does not exist, has no free base or no feet, or a push names a body that it lacks; a
            :class:`lgmpc.errors.ConfigErrors` if several of these hold.
        ModelError: with everything that the model lacks.
    """
    robot = build_any_robot(config)
    found = list(_misfits(config, robot))
    if found:
        raise found[0] if len(found) == 1 else ConfigErrors(found)
    return robot


def _misfits(config: Config, robot: Robot) -> Iterator[ConfigError]:
    """Find what a config asks of a robot that this one cannot do."""
    if not robot.floating_base:
        yield config.error(
            "robot.floating_base", f"a robot whose base is fixed ({robot.name})", "a robot that stands on its feet"
        )
    elif not robot.contact_frames:
        yield config.error(
            "robot.contact_frames", "no frames", f"the feet that {robot.name} stands on", _likely_feet(robot)
        )
    for i, push in enumerate(config.pushes):
        if push.body not in robot.body_names:
            yield config.error(f"pushes.{i}.body", push.body, f"a moving body of {robot.name}", robot.body_names)


def _likely_feet(robot: Robot) -> list[str]:
    """Return the frames whose name says foot or sole."""
    names = [frame.name for frame in robot.model.frames]
    return [name for name in names if "foot" in name.lower() or "sole" in name.lower()]


def _in_words_of_a_config(problem: str) -> str:
    """Call the arguments of :class:`RobotSpec` in a message by the keys they come from."""
    pattern = "|".join(re.escape(argument) for argument in _ROBOT_KEYS)
    return re.sub(rf"(?<![\w.])({pattern})(?!\w)", lambda match: _ROBOT_KEYS[match[1]], problem)
