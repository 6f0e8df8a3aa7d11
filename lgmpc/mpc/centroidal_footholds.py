"""Receding-horizon control of centre of mass and momenta by contact forces and footholds."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Literal, NamedTuple

import numpy as np
from pydantic import Field

from lgmpc.actions import CentroidalAction, CentroidalFootholdAction
from lgmpc.errors import InputError
from lgmpc.locomotion.horizon import ContactHorizon, MotionReference
from lgmpc.mpc.base import GRAVITY
from lgmpc.mpc.centroidal import CentroidalMpc, CentroidalSqpSettings
from lgmpc.mpc.interface import MeasuredState
from lgmpc.mpc.plan import Plan
from lgmpc.ocp import Trajectory
from lgmpc.robot.friction import facet_normals
from lgmpc.settings import Positive, Settings
from lgmpc.solvers import RealTimeResult
from lgmpc.typing import Array, BoolArray

__all__ = ["CentroidalFootholdMpc", "CentroidalFootholdMpcSettings", "FootholdDecisionSettings", "Landing", "landings"]

_LEAST_MARGIN = 1e-4
"""Least margin of a foothold, m: interior-point methods require constraints with an interior."""

_UNBOUNDED = 1e3
"""Margin of footholds that are not decided, in units of the control: no bound."""


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
        self._unit = float(np.sqrt(s.weights.forces(contacts, mass)[0] / s.footholds.weight))
        self._trust = s.footholds.trust_region_m
        self._normals = facet_normals(s.friction_facets)
        self._units = self.problem.view("foothold_unit")
        self._margins = self.problem.view("foothold_margin").reshape(s.nodes + 1, contacts, s.friction_facets)
        self._given_margins: Array = np.zeros((s.nodes, contacts, s.friction_facets))
        self._landings: list[Landing] = []

    @staticmethod
    def _make_action(contacts: int, facets: int) -> CentroidalAction:
        return CentroidalFootholdAction(contacts, facets)

    def update(self, state: MeasuredState, contacts: ContactHorizon, reference: MotionReference, wrench: Array) -> Plan:
        """Plan from the measured momenta; see :meth:`lgmpc.mpc.interface.Mpc.update`."""
        margins, shape = contacts.margins, self._given_margins.shape
        if margins.shape != shape:
            raise InputError("contacts.margins", f"shape {margins.shape}", f"shape {shape}")
        self._given_margins = margins
        self._landings = [each for each in landings(contacts.flags) if margins[each.begin, each.foot].any()]
        return super().update(state, contacts, reference, wrench)

    def _warm_start(self, t: float) -> None:
        """Shift the last trajectory to the present; footholds are not interpolated between nodes.

        The bounds on shifts are those of the horizon, intersected with the trust region about the guess.
        """
        super()._warm_start(t)
        n, nc = self.settings.nodes, self._contacts
        shifts, us = self.solver.xs[:, 9:].reshape(n + 1, nc, 2), self.solver.us.reshape(n, nc, 3)
        feet = [swing.foot for swing in self._landings]
        # One node after the touchdown: a shift in time by a part of an interval interpolates the node at the touchdown.
        known = shifts[[min(swing.end + 1, swing.until) for swing in self._landings], feet]
        margins = np.maximum(self._given_margins[[swing.begin for swing in self._landings], feet], _LEAST_MARGIN)
        guess = _within(known, margins, self._normals)
        near = np.minimum(margins, guess @ self._normals.T + self._trust) / self._unit
        self._units[...] = 0.0
        self._margins[...] = _UNBOUNDED
        shifts[...] = 0.0
        for i, (foot, begin, end, until) in enumerate(self._landings):
            shifts[end : until + 1, foot] = guess[i]
            us[begin:end, foot] = 0.0
            us[end - 1, foot, :2] = guess[i] / self._unit
            self._units[begin:end, foot] = self._unit
            self._margins[begin:end, foot] = near[i]

    def _describe(self, t: float, trajectory: Trajectory, result: RealTimeResult) -> Plan:
        n, nc = self.settings.nodes, self._contacts
        footholds = self._points[:n].copy()
        shifts = trajectory.xs[:, 9:].reshape(n + 1, nc, 2)
        for foot, begin, end, until in self._landings:
            footholds[begin:until, foot, :2] += shifts[end, foot]
        footholds.flags.writeable = False
        return self._make_plan(t, trajectory.xs[:, :9], self._forces(trajectory), result.kkt, footholds)


class Landing(NamedTuple):
    """A swing that ends within a horizon.

    Attributes:
        foot: index of the foot.
        begin: first interval in the air.
        end: first interval on the ground.
        until: end of the stance: its next lift-off, or the end of the horizon.
    """

    foot: int
    begin: int
    end: int
    until: int


def landings(flags: BoolArray) -> Iterator[Landing]:
    """Yield the swings that end within a horizon of flags (N, nc)."""
    n = len(flags)
    for foot, column in enumerate(flags.T.tolist()):
        end = 0
        while False in column[end:]:
            begin = column.index(False, end)
            if True not in column[begin:]:
                break
            end = column.index(True, begin)
            yield Landing(foot, begin, end, column.index(False, end) if False in column[end:] else n)


def _within(shifts: Array, margins: Array, normals: Array) -> Array:
    """Return shifts (n, 2), each scaled down to satisfy its bounds ``margins`` (n, m)."""
    along = shifts @ normals.T
    share = np.divide(margins, along, out=np.ones_like(along), where=along > margins)
    scaled: Array = shifts * share.min(axis=1, initial=1.0)[:, None]
    return scaled
