"""The robot of a config, checked against the rest of the config, and the limits of its joints and drives."""

from collections.abc import Iterator

import numpy as np
import pinocchio as pin

from lgmpc.config.schema import Config, Document
from lgmpc.control.drives import JointReferences
from lgmpc.errors import ConfigError, InputError, as_one_error
from lgmpc.locomotion.command import CommandTimeline
from lgmpc.locomotion.feasibility import infeasible_commands
from lgmpc.locomotion.legs import LegGeometry
from lgmpc.locomotion.settings import gaits_of
from lgmpc.robot import Robot, load_robot
from lgmpc.robot.checks import point_masses
from lgmpc.runs.limited import DriveLine, UnloggedLimits
from lgmpc.simulation.drives import ActuatorSettings
from lgmpc.simulation.initial import initial_state

_NARROWEST = 1e-3  # width of the contact points per length, below which they are on one line


def build_any_robot(config: Document) -> Robot:
    """Load a robot of any kind.

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
        ConfigError: if the robot does not exist, has no free base, has contact points on one line only, lacks a named
            body, joint or gait, or is commanded to move faster than its limits allow; a
            :class:`lgmpc.errors.ConfigErrors` if several of these hold.
        ModelError: with everything that the model lacks.
    """
    robot = build_any_robot(config)
    found = list(_misfits(config, robot))
    if found:
        raise as_one_error(found)
    return robot


def joint_limits(robot: Robot, drives: ActuatorSettings) -> UnloggedLimits:
    """Return the limits of joints that a log does not contain.

    Args:
        robot: the robot, with limits of position and speed.
        drives: settings of its drives, with or without a torque-speed line.
    """
    stall, no_load = drives.stall_torque_nm, drives.no_load_speed_rad_s
    line = None if stall is None or no_load is None else DriveLine(stall, no_load)
    return UnloggedLimits(robot.joint_lower, robot.joint_upper, robot.velocity_limit, line)


def _misfits(config: Config, robot: Robot) -> Iterator[ConfigError]:
    """Yield the errors of a config whose requirements this robot does not meet."""
    if not robot.floating_base:
        yield config.error(
            "robot.floating_base", f"a robot whose base is fixed ({robot.name})", "a robot that stands on its feet"
        )
    elif not robot.contact_frames:
        yield config.error(
            "robot.contact_frames", "no frames", f"the feet that {robot.name} stands on", _likely_feet(robot)
        )
    elif not (_spans_area(robot) or (robot.nc > 1 and _always_steps(config))):
        frames = ", ".join(robot.contact_frames)
        got = f"{robot.nc} contact point{'s on one line' if robot.nc > 1 else ''} ({frames})"
        expected = "three or more that are not on one line, or soles: robot.feet instead of contact_frames"
        expected += "; or two that always step: commands from at_s 0 on that are never zero" if robot.nc > 1 else ""
        yield config.error("robot.contact_frames", got, expected)
    points = point_masses(robot.model)
    if points and config.plant.kind == "mujoco":
        inertias = ", ".join(f"{inertia:.2g} kg.m2 ({body})" for body, inertia in points.items())
        source = "robot.model" if config.robot.urdf is None else "robot.urdf"
        words = f"an <inertia> of each in a URDF, of a sphere of its mass and the density of water {inertias}"
        yield config.error(source, f"{len(points)} bodies with mass but without rotational inertia", words)
    for i, push in enumerate(config.pushes):
        if push.body not in robot.body_names:
            yield config.error(f"pushes.{i}.body", push.body, f"a moving body of {robot.name}", robot.body_names)
    if robot.floating_base and robot.contact_frames:
        for error in _unusable_motions(config, robot):
            key = "robot.contact_frames" if error.argument == "contact_frames" else error.argument
            yield config.error(key, error.got, error.expected, error.choices)


def _unusable_motions(config: Config, robot: Robot) -> Iterator[InputError]:
    """Yield the errors in gaits, commands and the initial posture."""
    try:
        gaits = gaits_of(robot, config.locomotion)
        CommandTimeline(config.commands, gaits=gaits)
        legs = LegGeometry.of(robot)
    except InputError as error:
        yield error
    else:
        limits, share = config.locomotion.limits, config.modes.fall.height_share
        yield from infeasible_commands(config.commands, gaits, limits, legs, share)
    try:
        JointReferences(robot, config.drives, 1.0)
    except InputError as error:
        yield error
    try:
        initial_state(robot, config.plant)
    except InputError as error:
        yield error


def _spans_area(robot: Robot) -> bool:
    """Return whether the contact points of the reference posture, projected to the ground, span an area."""
    data = robot.create_data()
    pin.framesForwardKinematics(robot.model, data, robot.q_reference)
    points = np.array([data.oMf[frame].translation[:2] for frame in robot.contact_ids])
    extents = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return robot.nc >= 3 and bool(extents[1] > _NARROWEST * extents[0])


def _always_steps(config: Config) -> bool:
    """Return whether the commands have a robot step from the start to the end, as two points cannot stand."""
    commands = config.commands
    begun = bool(commands) and commands[0].at_s == 0.0
    return begun and all(any(c.velocity_m_s or ()) or bool(c.yaw_rate_rad_s) for c in commands)


def _likely_feet(robot: Robot) -> list[str]:
    """Return the frames whose name contains foot or sole."""
    names = [frame.name for frame in robot.model.frames]
    return [name for name in names if "foot" in name.lower() or "sole" in name.lower()]
