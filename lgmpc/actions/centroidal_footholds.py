r"""Centroidal dynamics with contact forces and footholds as controls.

The state has, besides the centroidal one, the horizontal shift ``d_i`` of each contact point from a nominal one:
``p_i = pn_i + (d_i, 0)``. A foot on the ground keeps it; one in the air has no force, and its two horizontal controls
are its shift instead, in units of a length s_i:

    d_i+ = d_i (on the ground),      d_i+ = s_i u_i (in the air)

Where s_i = 0 the next foothold is the nominal one. The last control of a swing thus determines the next foothold,
and the control has no more entries than without footholds. The moment ``(p_i - c) x f_i`` has a product of shift and
force: a Gauss-Newton step linearises it, which holds within a trust region.

The rows that keep the force of a foot on the ground within its friction pyramid keep the shift of one in the air within
a polygon with as many sides: ``n_j . u_i <= margin_ij`` for the facets' normals n_j.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from lgmpc.actions.centroidal import CentroidalAction
from lgmpc.costs import Cost, Parameter, ParameterLayout
from lgmpc.state.vector import StateVector

__all__ = ["CentroidalFootholdAction"]


class CentroidalFootholdAction(CentroidalAction):
    """Centre of mass and momenta driven by contact forces at points that are controls too (see the module).

    ``x = [c; l; k; d]`` (9 + 2 nc,), ``u`` (3 nc,), contact after contact: a force, N, or a shift [x, y, unused] in
    units of the parameter ``foothold_unit``.

    Args:
        contacts: number of contact points, nc.
        facets: sides of the friction pyramid and of the polygons of footholds, at least 3.

    Raises:
        InputError: no contact, or fewer than three facets.
    """

    def __init__(self, contacts: int, facets: int = 8) -> None:
        super().__init__(contacts, facets)
        self.name = f"centroidal_footholds_{contacts}x{facets}"
        self.state = StateVector(9 + 2 * contacts)
        self.parameters = ParameterLayout(
            *self.parameters.parameters,
            Parameter("foothold_unit", contacts, "s_i, m; 0 keeps the nominal foothold", sign="not negative"),
            Parameter(
                "foothold_margin",
                contacts * facets,
                "largest shift of the next foothold from its nominal point along each facet's normal, in units of s_i",
                sign="positive",
            ),
        )

    def step(self, x: Any, u: Any, p: Any) -> Any:
        """Return [c; l; k; d] at the end of the interval."""
        s = self.parameters.split(p)
        shifts = []
        for i in range(self.contacts):
            flag = s["contact_flags"][i]
            stays, moves = x[9 + 2 * i : 11 + 2 * i], u[3 * i : 3 * i + 2]
            shifts.append(flag * stays + (1 - flag) * s["foothold_unit"][i] * moves)
        return ca.vertcat(super().step(x, u, p), *shifts)

    def cost(self, x: Any, u: Any, p: Any) -> Cost:
        """Return the weighted squared distance from the reference state and forces, and of shifts from zero."""
        return super().cost(x[0:9], u, p)

    def terminal_cost(self, x: Any, p: Any) -> Cost:
        """Return the weighted squared distance from the reference state, with the last node's weights."""
        return super().terminal_cost(x[0:9], p)

    def _pyramid(self, contact: int, normal: Any, opened: Any, s: dict[str, Any]) -> tuple[Any, list[Any]]:
        """Return the normal force and the rows' least values; in the air the rows bound the next foothold."""
        flag = s["contact_flags"][contact]
        margins = s["foothold_margin"][self.facets * contact : self.facets * (contact + 1)]
        return flag * normal, ca.vertsplit(-(1 - flag) * margins)

    def _point(self, contact: int, x: Any, s: dict[str, Any]) -> Any:
        shift = x[9 + 2 * contact : 11 + 2 * contact]
        return super()._point(contact, x, s) + ca.vertcat(shift, 0)
