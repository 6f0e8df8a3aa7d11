"""The interface between a controller and a plant or robot: measurement, state, command.

Simulated plants and drivers of robots exchange the same values, so a controller depends on neither. This module imports
no other module of the package. The values are tuples with names: made at every tick, those cost a quarter of frozen
dataclasses.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from lgmpc.typing import Array, BoolArray

__all__ = ["Command", "Controller", "Estimator", "Measurement", "RobotState"]


class Measurement(NamedTuple):
    """One reading of the sensors on board.

    Attributes:
        time: when it was taken, s.
        gyro: (3,) mean angular velocity since the last reading, base axes, rad/s.
        accelerometer: (3,) mean specific force since the last reading, base axes, m/s2.
        joints: (nu,) joint angles, rad.
        speeds: (nu,) joint rates, rad/s.
        torques: (nu,) joint torques during the last step, N.m.
    """

    time: float
    gyro: Array
    accelerometer: Array
    joints: Array
    speeds: Array
    torques: Array


class RobotState(NamedTuple):
    """State of the robot, measured or estimated.

    Attributes:
        time: of the state, s.
        q: (nq,) configuration.
        v: (nv,) velocity.
        contacts: (nc,) whether each foot is in contact with the ground, as far as it is measured; None if it is not.
    """

    time: float
    q: Array
    v: Array
    contacts: BoolArray | None = None


class Command(NamedTuple):
    """Joint command of one control tick; the drives apply ``tau + kp (q_des - q) + kd (v_des - v)`` until the next.

    Attributes:
        tau: (nu,) feed-forward torque, N.m.
        q_des: (nu,) joint positions, rad.
        v_des: (nu,) joint velocities, rad/s.
        kp: N.m/rad.
        kd: N.m.s/rad.
    """

    tau: Array
    q_des: Array
    v_des: Array
    kp: float = 0.0
    kd: float = 0.0

    def torque(self, q: Array, v: Array) -> Array:
        """Return the torque (nu,) of the drives at positions and velocities whose last nu elements are the joints'."""
        if self.kp == 0.0 and self.kd == 0.0:
            return self.tau
        nu = self.tau.size
        torque: Array = self.tau + self.kp * (self.q_des - q[-nu:]) + self.kd * (self.v_des - v[-nu:])
        return torque

    @classmethod
    def damping(cls, tau: Array, joints: Array, kd: float) -> Command:
        """Return the command that holds the torque ``tau`` and damps the joints: the safe one after a failure."""
        return cls(tau, joints.copy(), np.zeros_like(joints), 0.0, kd)


class Controller(Protocol):
    """Computes a joint command from the state; it raises for no state."""

    def update(self, state: RobotState) -> Command:
        """Return the command to apply until the next control tick."""


class Estimator(Protocol):
    """Computes the state from measurements; it raises for no measurement."""

    def update(self, measurement: Measurement) -> RobotState:
        """Return the state at the time of the measurement."""
