r"""Principal connections: rotation by changes of shape at zero angular momentum (chapter 4.16).

A body of shape r (n) and attitude g moves with ``g' = g hat(xi)``. Zero angular momentum is the horizontal distribution
of the mechanical connection: ``xi = -A(r) r'``, ``A = I(r)^-1 m(r)``, from the locked inertia I and the momentum m of
the change of shape. Kelly and Murray, "Geometric phases and robotic locomotion", J. Robotic Systems 12 (1995); Marsden,
Montgomery and Ratiu, "Reduction, symmetry and phases in mechanics", Memoirs AMS 436 (1990).
"""

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from lgmpc.errors import InputError
from lgmpc.lie import checks, so3
from lgmpc.mechanics.checks import check_positive
from lgmpc.typing import Array

KineticEnergy = Callable[[Any, Any, Any], Any]
"""From shape r (n), angular velocity xi (1 or 3) in the body frame and shape velocity (n) to the energy, J."""

Loop = Callable[[Any], Any]
"""From the parameter s in [0, 1] to the shape (n), as a CasADi expression."""

_NODES = 0.5 + np.sqrt(0.15) * np.array([-1.0, 0.0, 1.0])
"""The three Gauss-Legendre nodes on [0, 1]."""


class Connection:
    """The mechanical connection of a kinetic energy that is invariant under rotations of the whole body.

    Args:
        energy: quadratic in the velocities; about the centre of mass, which is at rest.
        shapes: n, dimension of the shape.
        dimension: 1 for bodies in a plane (SO(2)), 3 for bodies in space (SO(3)).

    Attributes:
        shapes: n.
        dimension: 1 or 3.
        energy: (r, xi, r') to the kinetic energy, J; a CasADi function, as are the next three.
        locked_inertia: r to I (dimension, dimension), kg.m2.
        form: r to A (dimension, n).
        curvature: r to B (dimension, n * n): column ``i n + j`` is ``dA_j/dr_i - dA_i/dr_j - [A_i, A_j]``.

    Raises:
        InputError: dimensions other than those above.
    """

    def __init__(self, energy: KineticEnergy, shapes: int, dimension: int) -> None:
        if dimension not in (1, 3):
            raise InputError("dimension", dimension, "1 (in a plane) or 3 (in space)")
        if shapes < 1:
            raise InputError("shapes", shapes, "at least one")
        self.shapes, self.dimension = shapes, dimension
        r, xi, speed = ca.SX.sym("r", shapes), ca.SX.sym("xi", dimension), ca.SX.sym("speed", shapes)
        value = energy(r, xi, speed)
        momentum = ca.gradient(value, xi)
        inertia, coupling = ca.densify(ca.jacobian(momentum, xi)), ca.densify(ca.jacobian(momentum, speed))
        form = ca.solve(inertia, coupling)
        self.energy = ca.Function("energy", [r, xi, speed], [value])
        self.locked_inertia = ca.Function("locked_inertia", [r], [inertia])
        self.form = ca.Function("form", [r], [form])
        columns = []
        for i in range(shapes):
            for j in range(shapes):
                flat = ca.jacobian(form[:, j], r[i]) - ca.jacobian(form[:, i], r[j])
                columns.append(flat - self._bracket(form[:, i], form[:, j]))
        self.curvature = ca.Function("curvature", [r], [ca.densify(ca.horzcat(*columns))])

    def transport(self, loop: Loop, steps: int) -> Array:
        """Return the attitude along a curve of shapes, from the identity.

        Magnus' expansion of sixth order over equal steps of s (Blanes, Casas and Ros, "Improved high order integrators
        based on the Magnus expansion", BIT 40, 2000); in a plane it is Gauss-Legendre quadrature.

        Args:
            loop: the curve; it may have corners between steps.
            steps: their number.

        Returns:
            (steps + 1,) angles, rad, in a plane; (steps + 1, 3, 3) rotations in space.

        Raises:
            InputError: no steps, or a loop whose values are no shapes.
        """
        if steps < 1:
            raise InputError("steps", steps, "at least one")
        grid = (np.arange(steps)[:, None] + _NODES).ravel() / steps
        velocity = self._velocity(loop).map(grid.size)(grid[None, :]).full().T.reshape(steps, 3, self.dimension)
        first, middle, last = (velocity[:, k] / steps for k in range(3))
        if self.dimension == 1:
            turn = (5.0 * first + 8.0 * middle + 5.0 * last)[:, 0] / 18.0
            return np.concatenate((np.zeros(1), np.cumsum(turn)))
        # For g' = g xi left and right are exchanged: every bracket changes its sign.
        a1, a2, a3 = middle, np.sqrt(15.0) / 3.0 * (last - first), 10.0 / 3.0 * (last - 2.0 * middle + first)
        c1 = -np.cross(a1, a2)
        c2 = np.cross(a1, 2.0 * a3 + c1) / 60.0
        increments = so3.exp(a1 + a3 / 12.0 - np.cross(-20.0 * a1 - a3 + c1, a2 + c2) / 240.0)
        attitudes = np.empty((steps + 1, 3, 3))
        attitudes[0] = np.eye(3)
        for k, increment in enumerate(increments):
            attitudes[k + 1] = attitudes[k] @ increment
        return attitudes

    def holonomy(self, loop: Loop, steps: int = 200) -> Array:
        """Return the holonomy of a closed loop of shapes: (3, 3) rotation in space, () angle in a plane, rad.

        Raises:
            InputError: as :meth:`transport`, or a loop that does not close.
        """
        ends = [np.asarray(ca.DM(loop(ca.DM(s)))).ravel() for s in (0.0, 1.0)]
        gap = float(np.abs(ends[1] - ends[0]).max())
        if gap > 1e-9 * max(1.0, float(np.abs(ends[0]).max())):
            raise InputError("loop", f"a curve whose ends are {gap:.3g} apart", "a closed loop")
        return np.asarray(self.transport(loop, steps)[-1])

    def phase_by_area(self, loop: Loop, center: ArrayLike, nodes: int = 64) -> float:
        """Return minus the integral of the curvature over the area enclosed by a loop (Stokes), rad.

        It equals the holonomy of a body in a plane with two shape variables for loops of any size. Independent of
        :meth:`transport`: quadrature over the region, Gauss-Legendre in radius and the trapezoidal rule in angle.

        Args:
            loop: smooth, periodic and star-shaped about ``center``.
            center: (2,) a shape inside.
            nodes: of either quadrature (four times as many around).

        Raises:
            InputError: the body is not in a plane, or has another number of shape variables.
        """
        if self.dimension != 1 or self.shapes != 2:
            got = f"{self.shapes} shape variables, in {'a plane' if self.dimension == 1 else 'space'}"
            raise InputError("connection", got, "two shape variables, in a plane")
        middle = ca.DM(checks.tangent(2)("center", center))
        u, s = ca.SX.sym("u"), ca.SX.sym("s")
        point = middle + u * (loop(s) - middle)
        area = ca.det(ca.jacobian(point, ca.vertcat(u, s)))
        density = ca.Function("density", [u, s], [-self.curvature(point)[1] * area])
        x, weights = np.polynomial.legendre.leggauss(nodes)
        along, around = np.meshgrid((x + 1.0) / 2.0, np.arange(4 * nodes) / (4 * nodes), indexing="ij")
        values = density.map(along.size)(along.reshape(1, -1), around.reshape(1, -1)).full().reshape(along.shape)
        return float(weights / 2.0 @ values.mean(axis=1))

    def _velocity(self, loop: Loop) -> ca.Function:
        s = ca.SX.sym("s")
        shape = loop(s)
        if not isinstance(shape, ca.SX) or shape.shape != (self.shapes, 1):
            raise InputError("loop", f"values of shape {getattr(shape, 'shape', None)}", f"columns of {self.shapes}")
        return ca.Function("velocity", [s], [ca.densify(-self.form(shape) @ ca.jacobian(shape, s))])

    def _bracket(self, a: Any, b: Any) -> Any:
        return ca.cross(a, b) if self.dimension == 3 else ca.SX.zeros(1)


def circle(center: ArrayLike, radius: float) -> Loop:
    """Return the loop once around a circle in a plane of shapes, counter-clockwise from angle 0.

    Args:
        center: (2,).
        radius: positive.

    Raises:
        InputError: a centre of another shape, or a radius that is not positive.
    """
    middle = ca.DM(checks.tangent(2)("center", center))
    check_positive("radius", radius, "in units of the shape")
    return lambda s: middle + radius * ca.vertcat(ca.cos(2.0 * ca.pi * s), ca.sin(2.0 * ca.pi * s))
