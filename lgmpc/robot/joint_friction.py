"""The model of the joints' Coulomb friction in controllers and estimators."""

from __future__ import annotations

import casadi as ca

__all__ = ["FULL_SPEED", "joint_friction_torque"]

FULL_SPEED = 0.1
"""rad/s (m/s): where a joint reverses, its friction is smoothed over some of this; noise of speeds is well below it."""


def joint_friction_torque(friction: ca.SX, rates: ca.SX) -> ca.SX:
    r"""Return the torques (nu,) that overcome Coulomb friction, ``f_c tanh(v / v_s)``.

    Coulomb friction is discontinuous where a joint reverses. The smoothed magnitude stays below that of the joint, so
    that its compensation does not move a joint at rest.

    Args:
        friction: (nu,) f_c, N.m.
        rates: (nu,) v, rad/s.
    """
    return friction * ca.tanh(rates / FULL_SPEED)
