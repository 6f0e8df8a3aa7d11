"""What the loop sends to the joints, and what it asks of a controller."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lgmpc.typing import Array

__all__ = ["Command"]


@dataclass(frozen=True)
class Command:
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

    def torque(self, joints: Array, rates: Array) -> Array:
        """Torque (nu,) of the drives at joint positions ``joints`` and velocities ``rates``."""
        if self.kp == 0.0 and self.kd == 0.0:
            return self.tau
        torque: Array = self.tau + self.kp * (self.q_des - joints) + self.kd * (self.v_des - rates)
        return torque

    @classmethod
    def damping(cls, tau: Array, joints: Array, kd: float) -> Command:
        """Hold the torque ``tau`` and damp the joints: the safe command after a failure."""
        return cls(tau, joints.copy(), np.zeros_like(joints), 0.0, kd)
