"""The interface between a controller and a plant or robot: measurement, state, command.

Simulated plants and drivers of robots exchange the same values, so a controller depends on neither. This module imports
no other module of the package. The values are tuples with names: made at every tick, those cost a quarter of frozen
dataclasses.
"""

import logging
import math
from functools import cache
from typing import NamedTuple, Protocol

import numpy as np

from lgmpc.typing import Array, BoolArray, IntArray

_LOG = logging.getLogger(__name__)


class Measurement(NamedTuple):
    """One reading of the sensors on board; quantities that a robot does not measure are None.

    Attributes:
        time: when it was taken, s.
        gyro: (3,) mean angular velocity since the last reading, base axes, rad/s.
        accelerometer: (3,) mean specific force since the last reading, base axes, m/s2.
        joints: (nu,) joint angles, rad.
        speeds: (nu,) joint rates, rad/s.
        torques: (nu,) joint torques during the last step, N.m.
        attitude: (4,) orientation of the base by the IMU's own filter, quaternion x y z w.
        foot_forces: (nc,) normal forces of the feet, N.
        external_pose: (7,) base pose [position, quaternion x y z w] by motion capture or another external source.
        external_velocity: (6,) base velocity [linear; angular] by the same source, base axes, m/s and rad/s.
        external_age: time since these two were measured, s.
        supply_voltage: V.
        motor_temperature: (nu,) degrees Celsius.
        error_flags: (nu,) of the drives, whose bits have the robot's own meaning; 0: no error.
    """

    time: float
    gyro: Array
    accelerometer: Array
    joints: Array
    speeds: Array
    torques: Array
    attitude: Array | None = None
    foot_forces: Array | None = None
    external_pose: Array | None = None
    external_velocity: Array | None = None
    external_age: float | None = None
    supply_voltage: float | None = None
    motor_temperature: Array | None = None
    error_flags: IntArray | None = None


class RobotState(NamedTuple):
    """State of the robot, measured or estimated.

    Attributes:
        time: of the state, s.
        q: (nq,) configuration.
        v: (nv,) velocity.
        contacts: (nc,) whether each foot is in contact with the ground, as far as it is measured; None if it is not.
        torques: (nu,) measured joint torques during the last step, N.m; None if they are not.
    """

    time: float
    q: Array
    v: Array
    contacts: BoolArray | None = None
    torques: Array | None = None


class Command(NamedTuple):
    """Joint command of one control tick; the drives apply ``tau + kp (q_des - q) + kd (v_des - v)`` until the next.

    Attributes:
        tau: (nu,) feed-forward torque, N.m.
        q_des: (nu,) joint positions, rad.
        v_des: (nu,) joint velocities, rad/s.
        kp: (nu,) N.m/rad.
        kd: (nu,) N.m.s/rad.
    """

    tau: Array
    q_des: Array
    v_des: Array
    kp: Array
    kd: Array

    def torque(self, q: Array, v: Array) -> Array:
        """Return the torque (nu,) of the drives at positions and velocities whose last nu elements are the joints'."""
        nu = self.tau.size
        none = zeros(nu)
        if self.kp is none and self.kd is none:  # faster than a comparison of all elements
            return self.tau
        return self.tau + self.kp * (self.q_des - q[-nu:]) + self.kd * (self.v_des - v[-nu:])

    @property
    def fault(self) -> str:
        """The first element that is not finite, as "tau[2] is nan"; empty if there is none."""
        tau, q_des, v_des, kp, kd = self
        total = sum(tau.tolist()) + sum(q_des.tolist())
        if not (v_des is kp is kd is zeros(len(tau))):
            total += sum([*v_des.tolist(), *kp.tolist(), *kd.tolist()])
        if math.isfinite(total):
            return ""
        found = ((name, k, x) for name, each in self._asdict().items() for k, x in enumerate(each.tolist()))
        return next((f"{name}[{k}] is {x}" for name, k, x in found if not math.isfinite(x)), "a sum is not finite")

    @classmethod
    def feed_forward(cls, tau: Array, joints: Array) -> "Command":
        """Return the command of the torque ``tau`` alone, at joint positions ``joints`` (nu,)."""
        none = zeros(tau.size)
        return cls(tau, joints, none, none, none)

    @classmethod
    def damping(cls, tau: Array, joints: Array, kd: float) -> "Command":
        """Return the command that holds the torque ``tau`` and damps the joints: the safe one after a failure.

        Of the positions ``joints`` (nu,), those that are not finite become zero: their gains are.
        """
        none = zeros(tau.size)
        return cls(tau, np.where(np.isfinite(joints), joints, 0.0), none, none, np.full(tau.size, kd))


@cache
def zeros(size: int) -> Array:
    """Return the one read-only array of ``size`` zeros, which says that there is no gain."""
    array = np.zeros(size)
    array.flags.writeable = False
    return array


def command_limits(effort: Array) -> Command:
    """Return the largest magnitudes of commands that make sense for joints of the torque limits ``effort`` (nu,), N.m.

    They are far beyond those of any controller: ten times the torque, gains that reach the limit within 1 mrad and
    0.01 rad/s. A greater one is an error of units, or of a program.
    """
    effort = np.where(np.isfinite(effort), effort, 1e3)
    return Command(10.0 * effort, np.full(effort.size, 100.0), np.full(effort.size, 1e3), 1e3 * effort, 1e2 * effort)


class CommandGuard:
    """Replaces commands that cannot be meant by damping of the joints, counts them, and logs the first of a series.

    These are commands that are not finite and, where there are limits, those beyond them.

    Args:
        damping: of each joint, N.m.s/rad.
        limits: largest magnitudes, as of :func:`command_limits`; none unless given.

    Attributes:
        faults: number of commands replaced so far.
    """

    def __init__(self, damping: float, limits: Command | None = None) -> None:
        self.faults, self._damping, self._faulty, self._limits = 0, damping, False, limits

    def check(self, command: Command, time: float, q: Array) -> Command:
        """Return the command of ``time`` (s), or damping of the joints, whose positions are the last nu of ``q``."""
        fault = command.fault or self._excess(command)
        if fault:
            self.faults += 1
            if not self._faulty:
                what = "beyond bounds" if command.fault == "" else "not finite"
                _LOG.error("the command at %.3f s is %s (%s): the joints are damped instead", time, what, fault)
            nothing = np.zeros_like(command.tau)
            command = Command.damping(nothing, q[-nothing.size :], self._damping)
        self._faulty = bool(fault)
        return command

    def _excess(self, command: Command) -> str:
        """Return the first element beyond its limit, as "kp[3] is 1e+300, more than 1.8e+03"; empty if none is."""
        if self._limits is None:
            return ""
        none = zeros(command.tau.size)
        for name, values, most in zip(command._fields, command, self._limits, strict=True):
            if values is not none and (np.abs(values) > most).any():
                k = int(np.argmax(np.abs(values) > most))
                return f"{name}[{k}] is {values[k]:.3g}, more than {most[k]:.3g}"
        return ""


class Controller(Protocol):
    """Computes a joint command from the state; it raises for no state."""

    def update(self, state: RobotState) -> Command:
        """Return the command to apply until the next control tick."""


class Estimator(Protocol):
    """Computes the state from measurements; it raises for no measurement."""

    def update(self, measurement: Measurement) -> RobotState:
        """Return the state at the time of the measurement."""
