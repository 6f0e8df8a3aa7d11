"""Hands: frames whose pose the whole-body QP holds and moves, in the world or relative to the base."""

import math
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin

from lgmpc.costs import Parameter, StageSymbols
from lgmpc.lie.symbolic import so3
from lgmpc.robot import Robot
from lgmpc.timegrid import minimum_jerk
from lgmpc.typing import Array
from lgmpc.wbc.settings import HandMove, HandSettings
from lgmpc.wbc.tasks import SymbolicTask
from lgmpc.wbc.terms import WholeBodyTerms

_MOST_TURN = 0.2  # rad; error whose feedback the integral of the rotation may reach


class HandTask(SymbolicTask):
    """Pose of a frame in axes A, those of the world or of the base: errors ``p_d - p`` and ``log(R_d R^T)``.

    The first is limited in length. Targets: ``position`` (3,) m and ``rotation`` (3, 3), A from the frame; ``velocity``
    (6,) and ``acceleration`` (6,), [linear; angular] in A.

    Raises:
        InputError: the robot has no such frame.
    """

    dim = 6

    def __init__(self, robot: Robot, settings: HandSettings) -> None:
        self._index = robot.frame(settings.frame, "wbc.hands.frame")
        self._frame, self._in_world = settings.frame, settings.relative_to == "world"
        self._largest = settings.largest_error_m
        weights = [settings.weight] * 3 + [settings.rotation_weight] * 3
        super().__init__(settings.gain, weights, settings.frame)

    def targets(self) -> list[tuple[Parameter, tuple[int, ...]]]:
        """Return the target pose, its rotation row by row, and its motion."""
        return [
            (Parameter("position", 3, "of the frame's origin, m"), (3,)),
            (Parameter("rotation", 9, "of the frame", np.eye(3).ravel()), (3, 3)),
            (Parameter("velocity", 6, "[linear; angular], m/s and rad/s"), (6,)),
            (Parameter("acceleration", 6, "[linear; angular], m/s2 and rad/s2"), (6,)),
        ]

    def velocity(self, s: StageSymbols) -> Any:
        """Return the velocity [linear; angular] relative to A."""
        linear, angular = ca.vertsplit(s.velocity(self._frame, pin.LOCAL_WORLD_ALIGNED), 3)
        if self._in_world:
            return ca.vertcat(linear, angular)
        base = s.robot.joint_placement(s.q, 1)
        arm = s.placement(self._frame).translation - base.translation
        linear = ca.mtimes(base.rotation.T, linear) - s.v[:3] - ca.cross(s.v[3:6], ca.mtimes(base.rotation.T, arm))
        return ca.vertcat(linear, ca.mtimes(base.rotation.T, angular) - s.v[3:6])

    def error(self, s: StageSymbols) -> Any:
        """Return the limited way to the target, and the rotation vector to it."""
        position, rotation = self._pose(s)
        way = s["position"] - position
        way = way * ca.fmin(1.0, self._largest / ca.fmax(ca.norm_2(way), 1e-9))
        return ca.vertcat(way, so3.log(ca.mtimes(ca.reshape(s["rotation"], 3, 3).T, rotation.T)))

    def stand(self, robot: Robot, terms: WholeBodyTerms) -> None:
        """Hold the sensed pose."""
        self.aim(self.placement(robot, robot.model.createData(), terms.q))
        self.target.velocity[:] = self.target.acceleration[:] = 0.0

    def aim(self, pose: pin.SE3) -> None:
        """Set the target's pose."""
        self.target.position[:], self.target.rotation[:] = pose.translation, pose.rotation

    def placement(self, robot: Robot, data: pin.Data, q: Array) -> pin.SE3:
        """Return the frame's pose in A at a configuration (nq,)."""
        pin.forwardKinematics(robot.model, data, q)
        placement = pin.updateFramePlacement(robot.model, data, self._index)
        return self.axes(q).actInv(placement)

    def axes(self, q: Array) -> pin.SE3:
        """Return the pose of A in the world at a configuration (nq,)."""
        return pin.SE3.Identity() if self._in_world else pin.XYZQUATToSE3(q[:7])

    def _pose(self, s: StageSymbols) -> tuple[Any, Any]:
        hand = s.placement(self._frame)
        if self._in_world:
            return hand.translation, hand.rotation
        base = s.robot.joint_placement(s.q, 1)
        return ca.mtimes(base.rotation.T, hand.translation - base.translation), ca.mtimes(
            base.rotation.T, hand.rotation
        )


class HandMotion:
    """Motion of a hand's target over time: it stays where the hand was at the start, until it is moved.

    Args:
        robot: the controller's model.
        task: of the hand.
        settings: of the hand.
    """

    def __init__(self, robot: Robot, task: HandTask, settings: HandSettings) -> None:
        self._robot, self._task, self._settings = robot, task, settings
        self._data = robot.model.createData()
        self._moves, self._done = list(settings.moves), 0
        self._origin = pin.SE3.Identity()
        self._from, self._way = pin.SE3.Identity(), np.zeros(6)  # in A [linear; rotation vector in the frame]
        self._begun_s, self._duration = math.inf, 1.0
        self._integral, self._feed_forward = np.zeros((2, 6))

    def begin(self, terms: WholeBodyTerms) -> None:
        """Begin at the sensed place, from which poses in the world count; motions that are due come at once."""
        if self._settings.relative_to == "world":
            self._origin = pin.SE3(pin.utils.rotate("z", terms.yaw), terms.q[:3].copy())
        self._done, self._begun_s = 0, math.inf
        self._integral[:] = self._feed_forward[:] = 0.0

    def move(self, move: HandMove) -> None:
        """Add a motion, between two updates; its time is not before that of the last one."""
        self._moves.append(move)

    def update(self, time: float, elapsed: float, q: Array) -> None:
        """Write the target at a time, s.

        Args:
            time: of the state, s.
            elapsed: time since the last update, s.
            q: (nq,) sensed configuration.
        """
        target, settings = self._task.target, self._settings
        while self._done < len(self._moves) and self._moves[self._done].at_s <= time:
            self._start(self._moves[self._done], time)
            self._done += 1
        if self._begun_s < math.inf:
            share = min(max((time - self._begun_s) / self._duration, 0.0), 1.0)
            s, rate, curvature = minimum_jerk(share)
            way, turn = self._way[:3], self._way[3:]
            self._task.aim(pin.SE3(self._from.rotation @ pin.exp3(s * turn), self._from.translation + s * way))
            along = np.concatenate([way, self._from.rotation @ turn])
            target.velocity[:] = rate / self._duration * along
            target.acceleration[:] = self._feed_forward[:] = curvature / self._duration**2 * along
            if s == 1.0:
                self._begun_s = math.inf
        if settings.integral_gain > 0.0:
            self._integrate(elapsed, q)

    def reached_from(self, x: float, y: float) -> tuple[float, float]:
        """Return the place of the centre of mass, m, nearest to (x, y) from which the end of the motion is in reach."""
        reach, end = self._settings.reach_m, self._from.translation + self._way[:3]
        if reach is None or self._done == 0 or self._settings.relative_to == "base":
            return x, y
        dx, dy = float(end[0]) - x, float(end[1]) - y
        share = 1.0 - min(reach / max(math.hypot(dx, dy), 1e-9), 1.0)
        return x + share * dx, y + share * dy

    def poses(self, q: Array) -> Array:
        """Return (2, 7) poses in the world [position, quaternion x y z w] at a configuration: hand and target."""
        axes, target = self._task.axes(q), pin.SE3(self._task.target.rotation, self._task.target.position)
        hand = self._task.placement(self._robot, self._data, q)
        return np.array([pin.SE3ToXYZQUAT(axes * pose) for pose in (hand, target)])

    def _integrate(self, elapsed: float, q: Array) -> None:
        """Add the feedback of the integrated error, limited as that of the error itself, to the feed-forward."""
        target, settings = self._task.target, self._settings
        hand = self._task.placement(self._robot, self._data, q)
        self._integral[:3] += elapsed * (target.position - hand.translation)
        self._integral[3:] += elapsed * pin.log3(target.rotation @ hand.rotation.T)
        for part, most in ((self._integral[:3], settings.largest_error_m), (self._integral[3:], _MOST_TURN)):
            size = settings.integral_gain * math.sqrt(float(part @ part))
            part *= min(1.0, settings.gain.kp * most / max(size, 1e-12))
        target.acceleration[:] = self._feed_forward + settings.integral_gain * self._integral

    def _start(self, move: HandMove, time: float) -> None:
        target = self._task.target
        start = pin.SE3(target.rotation.copy(), target.position.copy())
        end = self._origin.actInv(start)
        if move.position_m is not None:
            end.translation = np.array(move.position_m)
        if move.rpy_deg is not None:
            end.rotation = pin.rpy.rpyToMatrix(*np.radians(move.rpy_deg))
        end = self._origin * end
        self._from, self._begun_s, self._duration = start, time, move.duration_s
        self._way[:3] = end.translation - start.translation
        self._way[3:] = pin.log3(start.rotation.T @ end.rotation)
