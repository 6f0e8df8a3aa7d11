"""From section ``robot`` of a config to a checked robot that the rest of the config fits."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pinocchio as pin

from lgmpc.config.schema import Config, Document
from lgmpc.errors import ConfigError, ConfigErrors, InputError
from lgmpc.robot import Robot, load_robot

__all__ = ["build_any_robot", "build_robot"]

_NARROWEST = 1e-3  # width of the contact points per length, below which they are on one line


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
        ConfigError: if the robot does not exist, has no free base, stands on contact points on one line, or a push
            names a body that it lacks; a :class:`lgmpc.errors.ConfigErrors` if several of these hold.
        ModelError: with everything that the model lacks.
    """
    robot = build_any_robot(config)
    found = list(_misfits(config, robot))
    if found:
        raise found[0] if len(found) == 1 else ConfigErrors(found)
    return robot


def _misfits(config: Config, robot: Robot) -> Iterator[ConfigError]:
    """Yield what a config requires of a robot that this one cannot do."""
    if not robot.floating_base:
        yield config.error(
            "robot.floating_base", f"a robot whose base is fixed ({robot.name})", "a robot that stands on its feet"
        )
    elif not robot.contact_frames:
        yield config.error(
            "robot.contact_frames", "no frames", f"the feet that {robot.name} stands on", _likely_feet(robot)
        )
    elif not _spans_area(robot):
        frames = ", ".join(robot.contact_frames)
        got = f"{robot.nc} contact point{'s on one line' if robot.nc > 1 else ''} ({frames})"
        expected = "three or more that are not on one line: contacts are points here, soles too, and carry no moment"
        yield config.error("robot.contact_frames", got, expected)
    for i, push in enumerate(config.pushes):
        if push.body not in robot.body_names:
            yield config.error(f"pushes.{i}.body", push.body, f"a moving body of {robot.name}", robot.body_names)


def _spans_area(robot: Robot) -> bool:
    """Return whether the contact points of the reference posture, seen from above, span an area to balance over."""
    data = robot.create_data()
    pin.framesForwardKinematics(robot.model, data, robot.q_reference)
    points = np.array([data.oMf[frame].translation[:2] for frame in robot.contact_ids])
    extents = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return robot.nc >= 3 and bool(extents[1] > _NARROWEST * extents[0])


def _likely_feet(robot: Robot) -> list[str]:
    """Return the frames whose name says foot or sole."""
    names = [frame.name for frame in robot.model.frames]
    return [name for name in names if "foot" in name.lower() or "sole" in name.lower()]
