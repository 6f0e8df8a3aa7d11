"""What every plant offers to the loop: reset, step, sense, and a wrench on a body."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from lgmpc.robot import Robot
    from lgmpc.simulation.parameters import PlantSettings

__all__ = ["Array", "Plant", "PlantSample", "make_plant"]

Array = NDArray[np.float64]


class PlantSample(NamedTuple):
    """State of a plant after a step, all in Pinocchio's conventions.

    Attributes:
        time: seconds since reset.
        q: (nq,) configuration.
        v: (nv,) velocity.
        tau: (nu,) joint torque applied during the last step, after clipping, N.m.
        contact_forces: (nc, 3) force on each contact frame during the last step, world axes, acting on the robot, N.
    """

    time: float
    q: Array
    v: Array
    tau: Array
    contact_forces: Array


class Plant(Protocol):
    """A robot in a physics engine. Its parameters (mass, friction, ...) may differ from the controller's model."""

    @property
    def dt(self) -> float:
        """Duration of one step, s."""

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of the bodies that a wrench can act on."""

    def reset(self, x: Array) -> None:
        """Put the robot into state ``x = (q, v)``, clear wrenches and set the time to zero."""

    def step(self, tau: Array) -> None:
        """Advance by ``dt`` under joint torques ``tau`` (nu,), N.m, clipped at the actuators' limits."""

    def sense(self) -> PlantSample:
        """Return the state reached by the last step."""

    def set_wrench(self, body: str, wrench: Array) -> None:
        """Apply ``wrench`` (6,) = [force; torque] in world axes at the centre of mass of ``body`` until it is changed.

        Raises:
            InputError: if the body is unknown (names the nearest) or the wrench is not six finite numbers.
        """

    def body_point(self, body: str) -> Array:
        """Return the (3,) world position of the centre of mass of ``body``."""


def make_plant(robot: Robot, settings: PlantSettings) -> Plant:
    """Return the simulated world that ``settings`` describe; only its engine is loaded."""
    if settings.kind == "pinocchio":
        from lgmpc.simulation.pinocchio import PinocchioPlant

        return PinocchioPlant(robot, settings)
    from lgmpc.simulation.mujoco import MujocoPlant

    return MujocoPlant(robot, settings)
