"""From section ``robot`` of a config to a checked robot that the rest of the config fits."""

from __future__ import annotations

from collections.abc import Iterator

from lgmpc.config.schema import Config, Document
from lgmpc.errors import ConfigError, ConfigErrors, InputError
from lgmpc.robot import Robot, load_robot

__all__ = ["build_any_robot", "build_robot"]


def build_any_robot(config: Document) -> Robot:
    """Load the robot, whatever kind of robot it is.

    Raises:
        ConfigError: if the robot does not exist.
        ModelError: with everything that the model lacks.
    """
    try:
        return load_robot(config.robot)
    except InputError as error:
        raise config.error(f"robot.{error.argument}", error.got, error.expected, error.choices) from error


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
