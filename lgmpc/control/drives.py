"""Joint references for the drives' own loop, which holds the predicted motion between two ticks."""

import numpy as np

from lgmpc.control.interface import Command, zeros
from lgmpc.errors import InputError
from lgmpc.robot import Robot
from lgmpc.robot.actuators import match_joints
from lgmpc.settings import NonNegative, PerJoint, Settings, key
from lgmpc.typing import Array


class DriveSettings(Settings):
    """Gains of the drives' own loop, ``tau + kp (q_des - q) + kd (v_des - v)``, about the motion of the whole-body QP.

    One gain for all joints, or ``{joint name or pattern: gain}``; 0 where there is none.
    """

    kp_nm_rad: PerJoint[NonNegative] = key(0.0, "Stiffness, N.m/rad.")
    kd_nms_rad: PerJoint[NonNegative] = key(0.0, "Damping, N.m.s/rad.")


class JointReferences:
    """Joint positions and velocities at the end of a tick, by the accelerations of the whole-body QP.

    Drives with gains lead the joints there, and oppose deviations at their own rate, also after the tick where the next
    command is late or lost.

    Args:
        robot: the controller's model.
        settings: see :class:`DriveSettings`.
        period: time between two ticks, s.

    Attributes:
        gains: (nu,) commanded over desired torque; None where all motors are sound.

    Raises:
        InputError: a key matches no joint, or there are gains for joints without one coordinate each.
    """

    def __init__(self, robot: Robot, settings: DriveSettings, period: float) -> None:
        self._period, self._joints, self._rates = period, robot.joint_q, robot.joint_v
        self._kp = _per_joint(robot, settings.kp_nm_rad, "drives.kp_nm_rad")
        self._kd = _per_joint(robot, settings.kd_nms_rad, "drives.kd_nms_rad")
        self._none = self._kp is self._kd
        self.gains: Array | None = None
        if not self._none and robot.q_reference[robot.joint_q].size != robot.nu:
            raise InputError("drives", "gains", f"none: {robot.name} has joints without one coordinate each")

    def command(self, tau: Array, q: Array, v: Array, acceleration: Array) -> Command:
        """Return the command for torques (nu,) in a state (nq,), (nv,) with accelerations (nv,)."""
        tau, joints = tau if self.gains is None else self.gains * tau, q[self._joints]
        if self._none:
            return Command(tau, joints, self._kp, self._kp, self._kp)
        now = v[self._rates]
        then = now + self._period * acceleration[self._rates]
        return Command(tau, joints + 0.5 * self._period * (now + then), then, self._kp, self._kd)


def _per_joint(robot: Robot, gain: float | dict[str, float], key: str) -> Array:
    """Return (nu,) gains; the array of no gain if all are zero."""
    given, wrong = match_joints(gain if isinstance(gain, dict) else {"*": gain}, robot.joint_names, key)
    if wrong:
        raise InputError(key, str(gain), "names or patterns of joints", robot.joint_names, word=next(iter(gain)))  # type: ignore[arg-type]
    values = np.array([given.get(name, 0.0) for name in robot.joint_names])
    return values if values.any() else zeros(robot.nu)
