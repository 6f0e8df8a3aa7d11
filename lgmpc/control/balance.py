"""Keep a legged robot standing: momentum observer, centroidal MPC and whole-body QP as one controller."""

from __future__ import annotations

import logging
from time import perf_counter

import numpy as np

from lgmpc.control.interface import Command, RobotState
from lgmpc.control.planner import Planner
from lgmpc.control.reference import ComReference
from lgmpc.estimation import FrictionMonitor
from lgmpc.robot import Robot
from lgmpc.typing import Array
from lgmpc.wbc import TickStatus, WholeBodyController

__all__ = ["BalanceController"]

_LOG = logging.getLogger(__name__)
_FALLEN_COSINE = 0.5  # of the tilt at which balancing ends


class BalanceController:
    """Controller of :mod:`lgmpc.simulation.loop`: state in, joint command out.

    The first finite state is the place to stand: its centre of mass and its contact points.
    Without a planner, the whole-body QP alone regulates the centre of mass to the reference.

    Args:
        robot: the controller's model.
        wbc: the whole-body controller.
        reference: where the centre of mass should go, relative to where it stands first.
        floor: how much friction can be relied on.
        planner: the MPC with its disturbance observer, or None.

    Attributes:
        wbc: the whole-body controller; its forces, torques and status are those of the last update.
        floor: as given.
        planner: as given.
        target: (3,) centre of mass that the user asked for at the last update, world, m.
        base_target: (7,) base pose that goes with it [position, quaternion x y z w].
        fallen: whether the base once tilted so far (60 degrees) that the controller gave up.
        wbc_ms: duration of the last update without the planner's, ms.
    """

    def __init__(
        self,
        robot: Robot,
        wbc: WholeBodyController,
        reference: ComReference,
        floor: FrictionMonitor,
        planner: Planner | None = None,
    ) -> None:
        self.robot = robot
        self.wbc = wbc
        self.floor = floor
        self.planner = planner
        self._reference = reference
        self._start_com: Array | None = None
        self._start_base = robot.q_reference[:7].copy()
        self._time = np.zeros(1)
        self.target = np.zeros(3)
        self.base_target = self._start_base.copy()
        self.wbc_ms = 0.0
        self.fallen = False

    def update(self, state: RobotState) -> Command:
        """Return the joint torques for the measured state; never raises for what the robot does."""
        started = perf_counter()
        time, q, v = state.time, state.q, state.v
        terms = self.wbc.sense(q, v)
        if self.fallen or terms.rotation[2, 2] < _FALLEN_COSINE:
            return self._give_up(time, q)
        if self._start_com is None:
            if not (np.isfinite(q).all() and np.isfinite(v).all()):
                return self._wait(time, q)
            self._begin(q)
        self._follow_reference(time)
        contacts = self.wbc.contacts
        contacts.friction[:] = self.floor.update(terms.contact_velocities, contacts.stance)
        planning = 0.0
        if self.planner is not None:
            self.planner.update(time, self.wbc)
            planning = self.planner.spent
        self.wbc.solve()
        if self.planner is not None:
            if self.wbc.status is TickStatus.SOLVED:
                self.planner.expect(terms, self.wbc.acceleration)
            else:
                self.planner.skip()
        command = Command(self.wbc.tau.copy(), q[self.robot.joint_q], np.zeros(self.robot.nu), 0.0, self.wbc.damping)
        self.wbc_ms = 1e3 * (perf_counter() - started - planning)
        return command

    def _give_up(self, time: float, q: Array) -> Command:
        """Let the joints go limp: whoever lies on his side cannot balance, and should not flail."""
        if not self.fallen:
            _LOG.warning("fallen at %.3f s: no torque from here on, joints damped", time)
        self.fallen = True
        self.wbc.tau[:] = 0.0
        self.wbc.forces[:] = 0.0
        if self.planner is not None:
            self.planner.planned = False
        return Command.damping(np.zeros(self.robot.nu), q[self.robot.joint_q], self.wbc.settings.fallback_damping_nms)

    def _wait(self, time: float, q: Array) -> Command:
        """Without a state there is no place to stand yet: no torque, joints damped."""
        _LOG.warning("no finite state yet at %.3f s: no torque, joints damped", time)
        return Command.damping(np.zeros(self.robot.nu), q[self.robot.joint_q], self.wbc.settings.fallback_damping_nms)

    def _begin(self, q: Array) -> None:
        """Stand where the robot is now."""
        terms = self.wbc.terms
        self._start_com = terms.com.copy()
        self._start_base = q[:7].copy()
        self.wbc.stand()
        if self.planner is not None:
            self.planner.begin(self.wbc)

    def _follow_reference(self, time: float) -> None:
        """Write the user's target into what the whole-body QP tracks."""
        assert self._start_com is not None
        self._time[0] = time
        offset, velocity, acceleration = (rows[0] for rows in self._reference.sample(self._time))
        np.add(self._start_com, offset, out=self.target)
        np.add(self._start_base[:3], offset, out=self.base_target[:3])
        com, base = (self.wbc.tasks[name].target for name in ("com", "base_position"))
        com.position[:] = self.target
        com.velocity[:] = base.velocity[:] = velocity
        com.acceleration[:] = acceleration
        base.position[:] = self.base_target[:3]
