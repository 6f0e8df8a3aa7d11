"""Feasibility of the commands of a timeline: limits, and the reach of the legs."""

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from lgmpc.errors import InputError
from lgmpc.locomotion.command import CommandEntry, CommandLimits, MotionCommand
from lgmpc.locomotion.gait import Gait
from lgmpc.locomotion.legs import LegGeometry

_PLANAR = 1e-6


def top_speed(legs: LegGeometry, gait: Gait, height: float = 0.0) -> float:
    """Return the largest speed at which the feet are within reach from touchdown to lift-off, m/s; 0 for standing.

    During a stance the hip travels by speed times stance duration over the foot: at most from the leg's reach behind
    the foot to its reach ahead.

    Args:
        legs: the legs.
        gait: gait, with the duration of its stances.
        height: height of the base relative to the reference posture, m.
    """
    drop = legs.hips[:, 2] - legs.feet[:, 2] + height
    reach = np.sqrt(np.maximum(legs.length**2 - drop**2, 0.0))
    return 0.0 if gait.stands else 2.0 * float(reach.min()) / gait.stance_s


def infeasible_commands(
    entries: Sequence[CommandEntry],
    gaits: Mapping[str, Gait],
    limits: CommandLimits,
    legs: LegGeometry,
    height_share: float,
) -> Iterator[InputError]:
    """Yield an error for each entry of a timeline that commands more than its limits or the legs allow.

    Args:
        entries: the timeline; gaits of moving commands exist.
        gaits: gaits by name.
        limits: section ``locomotion.limits``.
        legs: legs of the robot.
        height_share: share of the standing height at which the robot counts as fallen.
    """
    command = MotionCommand()
    stretch = float((legs.length - (legs.hips[:, 2] - legs.feet[:, 2])).min())
    lowest = (height_share - 1.0) * legs.height
    for i, entry in enumerate(entries):
        command = entry.change(command)
        speed, where = math.hypot(command.vx, command.vy), f"commands.{i}"
        if entry.height_m is not None and not lowest < entry.height_m < stretch:
            expected = (
                f"less than {stretch:.3g} m, at which the legs are stretched"
                if entry.height_m >= stretch
                else f"more than {lowest:.3g} m, at which the robot counts as fallen (modes.fall.height_share)"
            )
            yield InputError(f"{where}.height_m", f"{entry.height_m:g} m", expected)
            continue
        if entry.yaw_rate_rad_s is not None and abs(entry.yaw_rate_rad_s) > limits.yaw_rate_rad_s:
            expected = f"at most {limits.yaw_rate_rad_s:g} rad/s (locomotion.limits.yaw_rate_rad_s)"
            yield InputError(f"{where}.yaw_rate_rad_s", f"{entry.yaw_rate_rad_s:g} rad/s", expected)
        sideways = _sideways(where, entry, legs)
        if sideways is not None:
            yield sideways
        if not command.moves or (entry.velocity_m_s is None and entry.gait is None and entry.height_m is None):
            continue
        most, gait = top_speed(legs, gaits[command.gait], command.height), gaits[command.gait]
        key = f"{where}.velocity_m_s" if entry.velocity_m_s is not None else where
        if speed > limits.speed_m_s:
            expected = f"at most {limits.speed_m_s:g} m/s (locomotion.limits.speed_m_s)"
            yield InputError(key, f"{speed:g} m/s", expected)
        elif speed > most and not gait.stands:
            expected = f"at most {most:.3g} m/s: in gait {gait.name} the stance lasts {gait.stance_s:.3g} s"
            yield InputError(key, f"{speed:g} m/s", f"{expected}, and the legs reach no further")


def _sideways(where: str, entry: CommandEntry, legs: LegGeometry) -> InputError | None:
    """Return the error of a motion for which planar legs cannot place their feet, if there is one."""
    normals = legs.normals[legs.normals.any(axis=1)]
    if not len(normals):
        return None
    if entry.velocity_m_s is not None and np.abs(normals @ entry.velocity_m_s).max() > _PLANAR:
        key, (ahead, left) = "velocity_m_s", entry.velocity_m_s[:2]
        got = f"[{ahead:g}, {left:g}, 0] m/s"
        straight = np.abs(normals[:, 0]).max() < _PLANAR
        expected = f"a velocity {'straight ahead or back' if straight else 'in the plane of the legs'}"
    elif entry.yaw_rate_rad_s:
        key, got, expected = "yaw_rate_rad_s", f"{entry.yaw_rate_rad_s:g} rad/s", "0 rad/s"
    else:
        return None
    return InputError(f"{where}.{key}", got, f"{expected}: no joint moves the feet sideways")
