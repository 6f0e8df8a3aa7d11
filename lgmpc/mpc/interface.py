"""The interface of predictive controllers: from measured state, contacts and desired motion to a plan."""

from dataclasses import dataclass, fields
from typing import Any, Protocol

import numpy as np

from lgmpc.locomotion.horizon import ContactHorizon, MotionReference
from lgmpc.mpc.plan import Plan
from lgmpc.mpc.settings import MpcSettings
from lgmpc.typing import Array


@dataclass(frozen=True)
class MeasuredState:
    """Measured state in the quantities of the predictive models; each model reads those of its state.

    Attributes:
        time: time of the measurement, s.
        q: (nq,) configuration.
        v: (nv,) velocity.
        com: (3,) centre of mass, world, m.
        momentum: (6,) centroidal momentum [linear; angular], world axes.
        rotation: (3, 3) orientation of the base, body to world.
        inertia: (3, 3) locked inertia about the centre of mass: maps the angular velocity of the base, body axes, to
            angular momentum, world axes, kg.m2.
    """

    time: float
    q: Array
    v: Array
    com: Array
    momentum: Array
    rotation: Array
    inertia: Array

    @classmethod
    def centroidal(cls, time: float, com: Array, momentum: Array) -> "MeasuredState":
        """Return the state of a level robot of which only the centroidal state is measured."""
        nothing = np.zeros(0)
        return cls(time, nothing, nothing, np.asarray(com), np.asarray(momentum), np.eye(3), np.zeros((3, 3)))

    def copy(self) -> "MeasuredState":
        """Return the state with arrays of its own."""
        return MeasuredState(self.time, *(getattr(self, each.name).copy() for each in fields(self)[1:]))

    def angular_momentum(self, angular_velocity: Array) -> Array:
        """Return (n, 3) angular momentum with locked joints at ``angular_velocity`` (n, 3), world axes, N.m.s."""
        return angular_velocity @ (self.inertia @ self.rotation.T).T


class Mpc(Protocol):
    """A predictive controller.

    Attributes:
        settings: horizon, weights, limits.
        failures: updates without a fresh plan so far.
    """

    @property
    def settings(self) -> MpcSettings:
        """Horizon, weights, limits."""

    @property
    def failures(self) -> int:
        """Updates without a fresh plan so far."""

    def reset(self) -> None:
        """Discard all history: the next update starts as the first one."""

    def state(self) -> Any:
        """Return what the next update depends on besides its arguments, to :meth:`set_state`."""

    def set_state(self, state: Any) -> None:
        """Continue from a result of :meth:`state`."""

    def update(self, state: MeasuredState, contacts: ContactHorizon, reference: MotionReference, wrench: Array) -> Plan:
        """Plan from the measured state; numerical failures are reported by the status, not raised.

        Args:
            state: measured state.
            contacts: contacts over the N intervals of the horizon.
            reference: desired motion at the N + 1 nodes.
            wrench: (N, 6) predicted external [force; moment about the centre of mass], world axes, N and N.m.

        Returns:
            The new plan, or after a failure the last valid one, with the status of the failure.

        Raises:
            InputError: an array of the wrong shape.
        """
