"""Reaction to weak or dead motors, and to pushes on legs: the whole-body QP and the feet take them into account."""

import logging
import math
from dataclasses import replace

import numpy as np
import pinocchio as pin

from lgmpc.control.drives import JointReferences
from lgmpc.control.feet import Feet
from lgmpc.control.interface import RobotState
from lgmpc.estimation import FreeLegs, JointFaultMonitor
from lgmpc.estimation.joint_faults import legs_of_three
from lgmpc.locomotion.command import MotionCommand
from lgmpc.robot import Robot
from lgmpc.typing import GRAVITY, Array
from lgmpc.wbc import WholeBodyController

_LOG = logging.getLogger(__name__)

_LEAST_SHARE = 1e-3
"""Of a dead joint's torque limit, that the whole-body QP may use: with none, its rows would be degenerate."""

_SINKING = 1.6
"""Duration in which a robot lies down that would topple, in times in which a pendulum of its height falls e-fold."""
_ROUGH = 0.01
"""Roughness, in heights of the centre of mass, from which on what opposes a foot in the air is no push."""
_UNBOUNDED = np.array([[-1e3], [1e3], [1e4]])
"""Least and largest position, and speed: without torque no limit of a joint can be kept."""


class JointFaults:
    """Motors that have lost torque, and legs that something pushes: what whole-body QP, feet and commands make of them.

    The torque of a weak motor is bounded by its share, and the drive is commanded as much more. With a dead one the
    robot lies down and stays there: at once if it steps, or if the leg carries nothing any more, because of the forces
    that need no torque of the joint none is within friction. Torques of pushes on legs of three joints go to the
    whole-body QP, and feet of such legs stand only while they touch the ground, unless that is rough or mapped.

    Args:
        monitor: detects them; None to rely on all motors.
        robot: the controller's model.
        wbc: whose torque bounds are reduced.
        feet: that carry, or do not.
        references: that command the drives.
        period: time between two ticks, s.

    Attributes:
        shares: (nu,) of its torque that each motor gives.
        sinking_s: duration in which a robot that would topple lies down, s.
    """

    def __init__(
        self,
        monitor: JointFaultMonitor | None,
        robot: Robot,
        wbc: WholeBodyController,
        feet: Feet,
        references: JointReferences,
        period: float,
    ) -> None:
        self._monitor, self._robot, self._wbc, self._feet, self._references = monitor, robot, wbc, feet, references
        self.shares = np.ones(robot.nu) if monitor is None else monitor.shares
        self.sinking_s = _SINKING * math.sqrt(feet.legs.height / GRAVITY)
        self._dead = False
        joints = legs_of_three(robot)
        self._joints = np.array(joints)  # (nf, 3) of the legs
        self._legs = None if joints is None else FreeLegs(robot, period)

    @property
    def lame(self) -> bool:
        """Whether the robot would topple before it came to rest: a foot is lost, or a leg cannot finish its step."""
        return self._dead and (self._feet.stepping or bool(self._feet.lost.any()))

    def reset(self) -> None:
        """Forget what was measured, but not the faults."""
        self._wbc.joint_load[:], self._feet.events.pushed = 0.0, [False] * self._robot.nf
        for each in (self._monitor, self._legs):
            if each is not None:
                each.reset()

    def state(self) -> Array:
        """Return a copy of the shares that motors give."""
        return self.shares.copy()

    def set_state(self, shares: Array) -> None:
        """Continue with the shares (nu,) that were found before."""
        self.shares[:] = shares
        self._bound()

    def expect(self, torques: Array) -> None:
        """Store the torques (nu,) of the command that was just computed, N.m."""
        if self._monitor is not None:
            self._monitor.expect(torques)

    def watch(self, state: RobotState, missed: int) -> None:
        """Take the measured state of a tick in which only feet touch the ground, after ``missed`` without update."""
        if self._legs is not None:
            load, feet = self._legs.update(state, missed), self._feet
            if feet.mapped is not None or feet.roughness > _ROUGH * feet.legs.height:
                load[:] = 0.0  # there the ground is in the way of feet, too
            self._wbc.joint_load[:], feet.events.pushed = load, load[self._joints].any(axis=1).tolist()
        joint = None if self._monitor is None else self._monitor.update(state)
        if joint is None:
            return
        share, name = float(self.shares[joint]), self._robot.joint_names[joint]
        words = f"gives {100.0 * share:.0f} % of its torque" if share else "is dead"
        _LOG.warning("the motor of %s %s, by the motion at %.3f s", name, words, state.time)
        self._bound()
        if not share:
            self._leave_out(joint, state)

    def limited(self, request: MotionCommand) -> MotionCommand:
        """Return the request, or of a robot with a dead motor that to lie down."""
        if not self._dead or request.mode != "stand":
            return request
        return replace(request, vx=0.0, vy=0.0, yaw_rate=0.0, mode="lie", maneuver=None)

    def _bound(self) -> None:
        """Bound the torques to what the motors give, and command as much more."""
        shares, limits = self.shares, self._wbc.qp.limits
        self._dead = not shares.all()
        limits[0] = np.maximum(shares, _LEAST_SHARE) * self._robot.effort_limit
        limits[1:, shares == 0.0] = _UNBOUNDED
        self._references.gains = 1.0 / np.where(shares > 0.0, shares, 1.0)

    def _leave_out(self, joint: int, state: RobotState) -> None:
        """Let a foot carry nothing whose leg cannot push it to the ground without a joint.

        The torque is the force along the joint's lever, the foot's velocity at unit speed of the joint.
        """
        robot, contacts, data = self._robot, self._wbc.contacts, self._robot.create_data()
        for foot, frame in enumerate(robot.foot_ids):
            jacobian = pin.computeFrameJacobian(robot.model, data, state.q, frame, pin.LOCAL_WORLD_ALIGNED)
            lever = jacobian[:3, robot.nv - robot.nu + joint]
            friction, length = float(contacts.friction[foot]), float(np.linalg.norm(lever))
            upward = abs(float(lever @ contacts.normals[foot]))
            if upward * math.hypot(1.0, friction) > friction * length:
                self._feet.lost[foot] = True
                _LOG.warning("foot %s carries nothing without it", robot.foot_names[foot])
