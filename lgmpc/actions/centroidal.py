r"""Centroidal dynamics under contact forces that are constant over each interval, integrated exactly.

State ``x = [c; l; k]``: centre of mass (m), linear momentum (N.s), angular momentum about the centre of mass (N.m.s);
world axes. Control: the forces ``f_i`` (N, world axes, on the robot) at contact points ``p_i`` that do not move during
the interval. With the external force ``f_e`` and moment ``tau_e`` about the centre of mass, ``F = sum f_i`` and
``W = m g + F + f_e``:

    c' = l / m,      l' = W,      k' = sum (p_i - c) x f_i + tau_e

W is constant over an interval of duration h, so from (c0, l0, k0)

    l(t) = l0 + t W
    c(t) = c0 + t l0 / m + t^2 W / (2 m)
    k(h) = k0 + h (sum p_i x f_i + tau_e) - I x F,
           I = integral of c over [0, h] = h c0 + h^2 l0 / (2 m) + h^3 W / (6 m)

and ``W x F = (m g + f_e) x F`` because ``F x F = 0``. The step is exact: c is quadratic and k cubic in time, and it is
affine in the forces except for the products of F with c0 and l0 in k. (Centroidal dynamics: Orin, Goswami, Lee,
"Centroidal dynamics of a humanoid robot", Autonomous Robots 35, 2013.)

Each contact's force is constrained to the pyramid inscribed in its friction cone about the normal of the surface
(:mod:`lgmpc.robot.friction`), and its part along the normal to its bounds. The force of a foot whose flag is 0 is
multiplied by 0 in the dynamics, its reference in the cost is zero, and its constraints are relaxed so far that zero
lies strictly inside. For any flags the constraints thus have a nonempty interior, which interior-point methods require.

World axes keep the dynamics sparse in the forces: a third less work in each interval of the Riccati recursion than with
forces in the axes of the surfaces.
"""

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from lgmpc.actions.base import Action
from lgmpc.costs import Bounded, Cost, LeastSquares, Parameter, ParameterLayout
from lgmpc.errors import InputError
from lgmpc.robot.feet import UP, axes_of
from lgmpc.robot.friction import check_facets, friction_margins, pyramid_half_width
from lgmpc.state import StateVector
from lgmpc.typing import instance


class CentroidalAction(Action):
    """Centre of mass and momenta driven by contact forces, friction and normal force bounded (see the module).

    ``x = [c; l; k]`` (9,), ``u`` = forces (3 nc,), contact after contact. The path constraint has, for each contact,
    ``facets`` rows ``mu cos(pi/n) f_n - n_j . f >= 0`` and one row ``f_n``, the force along the normal. The bounds of
    normal forces are those of feet: of several points that are one foot, the sum has them, a row of its own, and that
    of each is only not negative.

    Args:
        contacts: number of contact points, nc.
        facets: sides of the friction pyramid, at least 3.
        feet: number of contact points of each foot; every point is a foot unless given.

    Raises:
        InputError: no contact, feet that have another number of points, or fewer than three facets.
    """

    def __init__(self, contacts: int, facets: int = 8, feet: Sequence[int] | None = None) -> None:
        instance("contacts", contacts, (int, np.integer), "a whole number")
        if contacts < 1:
            raise InputError("contacts", contacts, "at least one contact point")
        instance("facets", facets, (int, np.integer), "a whole number")
        check_facets(facets)
        self.contacts, self.facets = contacts, facets
        self.feet = (1,) * contacts if feet is None else tuple(int(count) for count in feet)
        if sum(self.feet) != contacts or min(self.feet) < 1:
            raise InputError("feet", self.feet, f"numbers of points of feet with {contacts} points together")
        soles = "" if max(self.feet) == 1 else f"_{'_'.join(map(str, self.feet))}"
        self.name = f"centroidal_{contacts}x{facets}{soles}"
        self.state = StateVector(9)
        self.nu = 3 * contacts
        self.parameters = ParameterLayout(
            Parameter("mass", 1, "mass of the robot, kg", sign="positive"),
            Parameter("gravity", 3, "acceleration of gravity, world axes, m/s^2"),
            Parameter("duration", 1, "length of the interval, s", sign="positive"),
            Parameter("contact_points", 3 * contacts, "positions of the contact points, world, m"),
            Parameter(
                "contact_normals", 3 * contacts, "unit normals of the surfaces, world axes", np.tile(UP, contacts)
            ),
            Parameter("contact_flags", contacts, "1 in contact, 0 in the air"),
            Parameter("friction", contacts, "friction coefficient at each contact", sign="not negative"),
            Parameter("normal_force_min", 1, "lowest normal force of a foot in contact, N"),
            Parameter("normal_force_max", 1, "highest normal force, N"),
            Parameter(
                "external_wrench", 6, "[force; moment about the centre of mass] on the robot, world axes, N, N.m"
            ),
            Parameter("x_reference", 9, "reference of [c; l; k]"),
            Parameter("u_reference", 3 * contacts, "reference of the forces, world axes, N"),
            Parameter("x_weight", 9, "weights of the squared state errors", sign="not negative"),
            Parameter("u_weight", 3 * contacts, "weights of the squared force errors, 1/N^2", sign="positive"),
        )

    def step(self, x: Any, u: Any, p: Any) -> Any:
        """Return [c; l; k] at the end of the interval, exactly (see the module)."""
        s = self.parameters.split(p)
        h, m = s["duration"], s["mass"]
        c, l, k = x[0:3], x[3:6], x[6:9]  # noqa: E741 - the momentum's usual name
        forces = self._effective_forces(u, s)
        total = ca.sum2(forces)
        moment = s["external_wrench"][3:6]  # about the world's origin, of the contact forces, and the external one
        for i in range(self.contacts):
            moment += ca.cross(s["contact_points"][3 * i : 3 * i + 3], forces[:, i])
        others = m * s["gravity"] + s["external_wrench"][0:3]
        resultant = others + total
        c_next = c + (h / m) * l + (h**2 / (2 * m)) * resultant
        c_integral = h * c + (h**2 / (2 * m)) * l
        k_next = k + h * moment - ca.cross(c_integral, total) - (h**3 / (6 * m)) * ca.cross(others, total)
        return ca.vertcat(c_next, l + h * resultant, k_next)

    def cost(self, x: Any, u: Any, p: Any) -> Cost:
        """Return the weighted squared distance from the reference state and forces."""
        s = self.parameters.split(p)
        u_reference = ca.vec(self._effective_forces(s["u_reference"], s))
        residual = ca.vertcat(x - s["x_reference"], u - u_reference)
        return LeastSquares(residual, ca.vertcat(s["x_weight"], s["u_weight"]))

    def terminal_cost(self, x: Any, p: Any) -> Cost:
        """Return the weighted squared distance from the reference state, with the last node's weights."""
        s = self.parameters.split(p)
        return LeastSquares(x - s["x_reference"], s["x_weight"])

    def constraint(self, x: Any, u: Any, p: Any) -> Bounded:
        """Return the friction pyramid and the normal force of each contact."""
        s = self.parameters.split(p)
        rows: list[Any] = []
        lower: list[Any] = []
        upper: list[Any] = []
        alone = [count == 1 for count in self.feet for _ in range(count)]
        normal: list[Any] = []
        for i in range(self.contacts):
            flag, block = s["contact_flags"][i], slice(3 * i, 3 * i + 3)
            force = ca.vertsplit(axes_of(s["contact_normals"][block]).T @ u[block])
            normal.append(force[2])
            half_width = pyramid_half_width(s["friction"][i], self.facets)
            opened = -(1 - flag) * s["normal_force_max"]
            rows += [*friction_margins(force, half_width, self.facets), force[2]]
            lowest = flag * s["normal_force_min"] + opened if alone[i] else opened
            lower += [*[opened] * self.facets, lowest]
            upper += [*[ca.SX(ca.inf)] * self.facets, s["normal_force_max"]]
        for first, count in zip(np.cumsum((0, *self.feet)).tolist(), self.feet, strict=False):
            if count > 1:
                flag = s["contact_flags"][first]
                opened = -count * (1 - flag) * s["normal_force_max"]
                rows.append(sum(normal[first : first + count]))
                lower.append(flag * s["normal_force_min"] + opened)
                upper.append(s["normal_force_max"])
        return Bounded(ca.vertcat(*rows), ca.vertcat(*lower), ca.vertcat(*upper))

    def _effective_forces(self, u: Any, s: dict[str, Any]) -> Any:
        """Return the forces (3, nc), zero for feet in the air."""
        return ca.reshape(u, 3, self.contacts) @ ca.diag(s["contact_flags"])
