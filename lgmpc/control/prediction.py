"""How the planner asks any predictive controller for a plan: a small protocol, and one class for each kind of state."""

from __future__ import annotations

import logging
from typing import Protocol

import numpy as np
import pinocchio as pin

from lgmpc.errors import InputError
from lgmpc.mpc import CentroidalLqr, CentroidalMpc, CentroidalPlan, WholeBodyMpc
from lgmpc.robot import Robot
from lgmpc.typing import Array
from lgmpc.wbc import WholeBodyReference, WholeBodyTerms

__all__ = ["CentroidalPredictor", "Predictor", "WholeBodyPredictor"]

_LOG = logging.getLogger(__name__)
_PAUSE = 4
"""Updates that the whole body's model sits out after a plan that was dropped: its subproblems are the dearest then."""


class Predictor(Protocol):
    """Makes plans over a horizon; all that :class:`~lgmpc.control.planner.Planner` knows of a model.

    Attributes:
        node_times: (N+1,) times of the nodes after the first one's, s.
        mass: of the robot, kg.
    """

    node_times: Array
    mass: float

    def reset(self) -> None:
        """Forget the past."""

    def predict(
        self, time: float, terms: WholeBodyTerms, tracked: WholeBodyReference, x_reference: Array, wrench: Array
    ) -> CentroidalPlan:
        """Plan from the measured state; never raises for what the robot does.

        Args:
            time: of the state, s.
            terms: measured state, and what follows from it.
            tracked: stance, friction and target posture.
            x_reference: (N+1, 9) [centre of mass; linear momentum; angular momentum] to stay near; may be written to.
            wrench: (N, 6) predicted external [force; moment about the centre of mass].
        """


class CentroidalPredictor:
    """Plans with a model that knows neither base nor joints.

    A tilted base is turned upright by asking for the angular momentum ``-I rate * tilt``, fading at this rate.

    Args:
        mpc: the receding-horizon controller, or the regulator.
        uprighting_rate: 1/s.

    Attributes:
        mpc: as given.

    Raises:
        InputError: a negative rate.
    """

    def __init__(self, mpc: CentroidalMpc | CentroidalLqr, uprighting_rate: float = 0.0) -> None:
        if not uprighting_rate >= 0:
            raise InputError("uprighting_rate", uprighting_rate, "a rate that is not negative, 1/s")
        self.mpc = mpc
        self.mass = mpc.mass
        self.node_times = _node_times(mpc)
        self._uprighting = uprighting_rate * np.exp(-uprighting_rate * self.node_times)[:, None]

    def reset(self) -> None:
        """Forget the past."""
        self.mpc.reset()

    def predict(
        self, time: float, terms: WholeBodyTerms, tracked: WholeBodyReference, x_reference: Array, wrench: Array
    ) -> CentroidalPlan:
        """Plan from the measured momenta; see :class:`Predictor`."""
        tilt = pin.log3(terms.rotation.T @ tracked.base_rotation)  # body axes, towards upright
        x_reference[:, 6:9] = self._uprighting * (terms.momentum_matrix[3:, 3:6] @ tilt)
        if tracked.friction is not None:
            self.mpc.friction = tracked.friction
        return self.mpc.update(
            time,
            terms.com,
            terms.momentum[:3],
            terms.momentum[3:],
            terms.contact_points,
            tracked.stance,
            x_reference,
            wrench,
        )


class WholeBodyPredictor:
    """Plans with a model that knows base and joints, towards the robot's reference posture, as far as its legs reach.

    A stretched leg is singular: linearised there, it promises motions that it does not have, and an iteration from such
    a plan leads away from the solution. In a push hard enough the forecast gets there long before the robot does, if
    the robot does at all. So a plan that stretches a leg further than the model's ``reach``, like one that failed, is
    dropped, and a centroidal model, which has no legs to stretch, plans instead. Every fifth update the whole body's is
    tried again, and followed from the second plan in a row that keeps the reach: the first began without a guess.

    Args:
        mpc: the receding-horizon controller.
        robot: whose reference posture to stay near.
        stand_in: plans meanwhile.

    Attributes:
        mpc: as given.
        stand_in: as given.
        stood_in: updates so far that the stand-in planned.
    """

    def __init__(self, mpc: WholeBodyMpc, robot: Robot, stand_in: CentroidalPredictor) -> None:
        self.mpc = mpc
        self.stand_in = stand_in
        self.mass = mpc.mass
        self.node_times = _node_times(mpc)
        self.stood_in = 0
        self._q_reference = robot.q_reference
        self._trusted = True
        self._pause = 0

    def reset(self) -> None:
        """Forget the past."""
        self.mpc.reset()
        self.stand_in.reset()
        self.stood_in = 0
        self._trusted = True
        self._pause = 0

    def predict(
        self, time: float, terms: WholeBodyTerms, tracked: WholeBodyReference, x_reference: Array, wrench: Array
    ) -> CentroidalPlan:
        """Plan from the measured configuration and velocity; see :class:`Predictor`."""
        if self._pause > 0:
            self._pause -= 1
        else:
            trusted_before = self._trusted
            plan = self._plan(time, terms, tracked, x_reference, wrench)
            if self._trusted and trusted_before:
                return plan
            if trusted_before:
                _LOG.info("at %.3f s the plan stretches the legs or failed: the centroidal model plans instead", time)
        self.stood_in += 1
        return self.stand_in.predict(time, terms, tracked, x_reference, wrench)

    def _plan(
        self, time: float, terms: WholeBodyTerms, tracked: WholeBodyReference, x_reference: Array, wrench: Array
    ) -> CentroidalPlan:
        """Let the whole body's model plan, and judge the plan."""
        if tracked.friction is not None:
            self.mpc.friction = tracked.friction
        plan = self.mpc.update(time, terms.q, terms.v, tracked.stance, x_reference, self._q_reference, wrench)
        self._trusted = plan.status.fresh and self.mpc.keeps_reach(plan)
        if not self._trusted:
            self.mpc.forget()
            self._pause = _PAUSE
        return plan


def _node_times(mpc: CentroidalMpc | CentroidalLqr | WholeBodyMpc) -> Array:
    times: Array = mpc.settings.node_duration * np.arange(mpc.settings.nodes + 1, dtype=np.float64)
    return times
