"""Receding-horizon control of centre of mass and momenta by contact forces and footholds."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
from pydantic import Field

from lgmpc.actions import CentroidalAction, CentroidalFootholdAction
from lgmpc.errors import InputError
from lgmpc.locomotion.horizon import ContactHorizon, MotionReference
from lgmpc.mpc.base import GRAVITY
from lgmpc.mpc.centroidal import CentroidalMpc, CentroidalSqpSettings
from lgmpc.mpc.foothold_shifts import FootholdShifts
from lgmpc.mpc.interface import MeasuredState
from lgmpc.mpc.plan import Plan
from lgmpc.ocp import Trajectory
from lgmpc.settings import Positive, Settings
from lgmpc.solvers import RealTimeResult
from lgmpc.typing import Array

__all__ = ["CentroidalFootholdMpc", "CentroidalFootholdMpcSettings", "FootholdDecisionSettings"]


class FootholdDecisionSettings(Settings):
    """Cost and trust region of the shifts of footholds from the nominal ones."""

    weight: Positive = Field(
        default=1e3, description="Weight of the squared shift of a foothold from the nominal one, 1/m2."
    )
    trust_region_m: Positive = Field(
        default=0.03,
        description="Largest change of a foothold from one iteration to the next, m: the moment of a force about the"
        " centre of mass is linear in the foothold only for a constant force.",
    )


class CentroidalFootholdMpcSettings(CentroidalSqpSettings):
    """Model-predictive control of the momenta by contact forces and footholds over a receding horizon."""

    model: Literal["centroidal_footholds"] = Field(default="centroidal_footholds", description="Predictive model.")
    footholds: FootholdDecisionSettings = Field(
        default=FootholdDecisionSettings(), description="Footholds as decision variables."
    )

    @property
    def foothold_directions(self) -> int:
        """Number of sides of the polygons that bound footholds."""
        return self.friction_facets


class CentroidalFootholdMpc(CentroidalMpc):
    """Plans contact forces, and the footholds of all swings that end within the horizon, as shifts from nominal ones.

    As :class:`~lgmpc.mpc.centroidal.CentroidalMpc`, on the model of
    :class:`~lgmpc.actions.centroidal_footholds.CentroidalFootholdAction`. The contact points of the horizon are the
    heuristic footholds, its ``margins`` bound the shifts; a zero shift is always admissible, so every update has a
    feasible solution.

    Args:
        mass: mass of the robot, kg.
        contacts: number of contact points, nc.
        settings: horizon, weights, limits.
        gravity: (3,) world axes, m/s^2.
        progress: called with a description of what is being compiled.

    Raises:
        InputError: mass not positive, no contact, or gravity not three finite numbers.
        MissingDependencyError: the QP solver is not installed.
    """

    def __init__(
        self,
        mass: float,
        contacts: int,
        settings: CentroidalFootholdMpcSettings | None = None,
        *,
        gravity: tuple[float, float, float] | Array = GRAVITY,
        progress: Callable[[str], None] | None = None,
    ) -> None:
        s = CentroidalFootholdMpcSettings() if settings is None else settings
        super().__init__(mass, contacts, s, gravity=gravity, progress=progress)
        self.settings: CentroidalFootholdMpcSettings = s
        # A shift has the weight of a force in the units of the control.
        unit = float(np.sqrt(s.weights.forces(contacts, mass)[0] / s.footholds.weight))
        self._shifts = FootholdShifts(
            self.problem, self.solver.xs, s.friction_facets, unit, s.footholds.trust_region_m, progress
        )

    @staticmethod
    def _make_action(contacts: int, facets: int) -> CentroidalAction:
        return CentroidalFootholdAction(contacts, facets)

    def update(self, state: MeasuredState, contacts: ContactHorizon, reference: MotionReference, wrench: Array) -> Plan:
        """Plan from the measured momenta; see :meth:`lgmpc.mpc.interface.Mpc.update`."""
        shape = (self.settings.nodes, self._contacts, self.settings.friction_facets)
        if contacts.margins.shape != shape:
            raise InputError("contacts.margins", f"shape {contacts.margins.shape}", f"shape {shape}")
        self._shifts.margins[...] = contacts.margins.reshape(len(contacts.margins), -1)
        return super().update(state, contacts, reference, wrench)

    def _warm_start(self, t: float) -> None:
        """Shift the last trajectory to the present; footholds are not interpolated between nodes."""
        super()._warm_start(t)
        self._shifts.bound()

    def _describe(self, t: float, trajectory: Trajectory, result: RealTimeResult) -> Plan:
        self._shifts.place()
        footholds = self._shifts.footholds.copy()
        footholds.flags.writeable = False
        return self._make_plan(t, trajectory.xs[:, :9].copy(), self._forces(trajectory), result.kkt, footholds)
