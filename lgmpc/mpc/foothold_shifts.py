"""Decided shifts of footholds over a horizon: their guess, their bounds, and the footholds that follow.

Each is one compiled call over all intervals and feet. The control of a swing's last interval decides where the foot
touches down; all others of a foot in the air have no effect.
"""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from lgmpc.compile import StageKernel
from lgmpc.ocp import ShootingProblem
from lgmpc.robot.friction import facet_normals
from lgmpc.typing import Array

__all__ = ["FootholdShifts"]

_LEAST_MARGIN = 1e-4
"""Least margin of a foothold, m: interior-point methods require constraints with an interior."""

_UNBOUNDED = 1e3
"""Margin of footholds that are not decided, in units of the control: no bound."""


class FootholdShifts:
    """Shifts of a problem with the model of :class:`~lgmpc.actions.centroidal_footholds.CentroidalFootholdAction`.

    A foothold is decided where a swing ends within the horizon and a margin of its last interval is above zero.

    Args:
        problem: whose flags and points are read, and whose units and margins are written.
        xs: (N+1, nx) guess, later solution; the shifts among the states are read and written.
        facets: number of directions of the margins, m.
        unit: of a shift's control, m.
        trust: largest change of a shift from one guess to the next, m.
        progress: called with a description of what is being compiled.

    Attributes:
        margins: (N, nc m) largest shifts from the nominal foothold towards each direction, m; to be written.
        footholds: (N, nc, 3) contact points, of a foot in the air the next one; written by :meth:`place`.

    Raises:
        CompileError: the compiler failed.
    """

    def __init__(
        self,
        problem: ShootingProblem,
        xs: Array,
        facets: int,
        unit: float,
        trust: float,
        progress: Callable[[str], None] | None = None,
    ) -> None:
        n, view = problem.nodes, problem.view
        flags, points = view("contact_flags"), view("contact_points")
        contacts = flags.shape[1]
        self.margins: Array = np.zeros((n, contacts * facets))
        points_now = np.zeros((n, 3 * contacts))
        self.footholds: Array = points_now.reshape(n, contacts, 3)
        self._shifts = xs[:, -2 * contacts :]
        self._known = np.zeros((n + 2, 2 * contacts))  # node N + 1 is never read by a foot that touches down
        coming = np.zeros((n + 1, 2 * contacts))
        self._bound = StageKernel.of(_bounds, contacts, facets, progress=progress).bind(
            n, flags=flags, flags_next=flags[1:], given=self.margins, known=self._known[2:], shift=self._shifts,
            scale=np.array([unit, trust]), shift_next=self._shifts[1:], unit=view("foothold_unit"),
            margin=view("foothold_margin"),
        )  # fmt: skip
        self._place = StageKernel.of(_places, contacts, progress=progress).bind(
            n, flags=flags[n - 1 :: -1], points=points[n - 1 :: -1], shift=self._shifts[n - 1 :: -1],
            coming_next=coming[:0:-1], coming=coming[-2::-1], footholds=points_now[::-1],
        )  # fmt: skip

    def bound(self) -> None:
        """Make the shifts of a guess, moved ahead in time, constant from touchdown to lift-off, and write the bounds.

        Shifts become those of one node after the touchdown: a move in time by a part of an interval interpolates the
        node at the touchdown. They are scaled down to satisfy their margins. Bounds are the margins, intersected with
        the trust region about the guess. Controls stay as they are: those of feet in the air have a linear effect.
        """
        self._known[:-1] = self._shifts
        self._shifts[0] = 0.0  # a foot on the ground is where it is
        self._bound()

    def place(self) -> None:
        """Write the footholds of a solution."""
        self._place()


def _bounds(contacts: int, facets: int) -> ca.Function:
    """Return the shifts of the next node, and units and margins of an interval."""
    sizes = {
        "flags": contacts, "flags_next": contacts, "given": contacts * facets, "known": 2 * contacts,
        "shift": 2 * contacts, "scale": 2,
    }  # fmt: skip
    s = {name: ca.SX.sym(name, size) for name, size in sizes.items()}
    normals, (unit, trust) = facet_normals(facets), ca.vertsplit(s["scale"])
    shifts, units, margins = [], [], []
    for i in range(contacts):
        given, known = s["given"][facets * i : facets * (i + 1)], s["known"][2 * i : 2 * i + 2]
        stands, stands_next = s["flags"][i] > 0, s["flags_next"][i] > 0
        lands = ca.logic_and(ca.logic_and(ca.logic_not(stands), stands_next), ca.mmax(given) > 0)
        room, along = ca.fmax(given, _LEAST_MARGIN), normals @ known
        share = ca.mmin(ca.if_else(along > room, room / along, 1))
        near = ca.fmin(room, share * along + trust) / unit
        shifts.append(ca.if_else(stands, s["shift"][2 * i : 2 * i + 2], ca.if_else(lands, share * known, 0)))
        units.append(ca.if_else(lands, unit, 0))
        margins.append(ca.if_else(lands, near, _UNBOUNDED))
    outputs = [ca.vertcat(*each) for each in (shifts, units, margins)]
    name = f"foothold_bounds_{contacts}x{facets}"
    return ca.Function(name, list(s.values()), outputs, list(s), ["shift_next", "unit", "margin"])


def _places(contacts: int) -> ca.Function:
    """Return the shift of the present or next foothold in an interval, from that in the next one, and the footholds."""
    sizes = {"flags": contacts, "points": 3 * contacts, "shift": 2 * contacts, "coming_next": 2 * contacts}
    s = {name: ca.SX.sym(name, size) for name, size in sizes.items()}
    stands = ca.repmat(s["flags"].T, 2, 1) > 0
    coming = ca.if_else(stands, ca.reshape(s["shift"], 2, contacts), ca.reshape(s["coming_next"], 2, contacts))
    footholds = ca.reshape(s["points"], 3, contacts) + ca.vertcat(coming, ca.SX.zeros(1, contacts))
    outputs = [ca.vec(coming), ca.vec(footholds)]
    return ca.Function(f"foothold_places_{contacts}", list(s.values()), outputs, list(s), ["coming", "footholds"])
