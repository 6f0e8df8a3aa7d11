"""Residuals of contact forces; values and derivatives are finite at zero force."""

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from lgmpc.costs.parameters import Parameter
from lgmpc.costs.residual import Residual
from lgmpc.costs.symbols import StageSymbols
from lgmpc.errors import InputError
from lgmpc.robot.feet import UP, axes_of
from lgmpc.robot.friction import check_facets, friction_margins, pyramid_half_width
from lgmpc.typing import instance, numbers


class ContactForce(Residual):
    """Contact force (3,), or wrench (6,), minus ``reference``; world axes at the frame's origin, N and N.m.

    Args:
        frame: name of the contact.
        size: 3 for a point contact, 6 for a surface.
        reference: default of the parameter ``reference``.
    """

    def __init__(self, frame: str, size: int = 3, reference: ArrayLike = 0.0) -> None:
        self.frame, self.nr = frame, size
        self.parameters = (Parameter("reference", size, "reference of the contact force, world axes, N", reference),)

    def expression(self, s: StageSymbols) -> Any:
        """Return the difference."""
        return s.force(self.frame) - s["reference"]


class FrictionCone(Residual):
    """The pyramid inscribed in the friction cone (facets + 1,), N: all entries are positive strictly inside.

        mu cos(pi / n) f_z - cos(2 pi j / n) f_x - sin(2 pi j / n) f_y,   j = 0 .. n - 1;      f_z

    in the axes of the surface, z being its normal. As a constraint: ``lower=0, upper=inf``. As a cost:
    ``QuadraticBarrier(0.0, np.inf)``.

    Args:
        frame: name of the contact.
        facets: n, at least 3.
        friction: default of the parameter ``friction``.
        normal: (3,) unit normal of the surface, world axes; default of the parameter ``normal``.

    Raises:
        InputError: too few facets, or a normal that is no unit vector.
    """

    def __init__(self, frame: str, facets: int = 8, friction: float = 0.7, normal: ArrayLike = UP) -> None:
        instance("facets", facets, (int, np.integer), "a whole number, at least 3")
        check_facets(facets)
        if not abs(float(np.linalg.norm(numbers("normal", normal, (3,)))) - 1.0) < 1e-9:
            raise InputError("normal", normal, "a unit vector (3,)")
        self.frame, self.facets, self.nr = frame, facets, facets + 1
        self.parameters = (
            Parameter("friction", 1, "friction coefficient", friction, "not negative"),
            Parameter("normal", 3, "unit normal of the surface, world axes", normal),
        )

    def expression(self, s: StageSymbols) -> Any:
        """Return the distances from the facets."""
        force = ca.vertsplit(axes_of(s["normal"]).T @ s.force(self.frame)[:3])
        half_width = pyramid_half_width(s["friction"], self.facets)
        return ca.vertcat(*friction_margins(force, half_width, self.facets), force[2])


class CenterOfPressure(Residual):
    """Centre of pressure within a rectangle about the frame's origin (4,), N.m: positive strictly inside.

    With the wrench in the frame's own axes, z being the surface's normal and the rectangle 2 a by 2 b:
    ``a f_z - m_y, a f_z + m_y, b f_z - m_x, b f_z + m_x``. Finite at zero force.

    Args:
        frame: name of a surface contact.
        half_size: (a, b) along the frame's x and y, m; default of the parameter ``half_size``.
    """

    nr = 4

    def __init__(self, frame: str, half_size: tuple[float, float]) -> None:
        self.frame = frame
        self.parameters = (Parameter("half_size", 2, "half lengths of the surface along x and y, m", half_size),)

    def expression(self, s: StageSymbols) -> Any:
        """Return the four margins.

        Raises:
            InputError: the contact is a point.
        """
        force, moment = _wrench(s, self.frame)
        reach_y, reach_x = s["half_size"][0] * force[2], s["half_size"][1] * force[2]
        return ca.vertcat(reach_y - moment[1], reach_y + moment[1], reach_x - moment[0], reach_x + moment[0])


class WrenchCone(Residual):
    """The wrenches that a rectangle can transmit (17,), N and N.m: all entries are positive strictly inside.

    With the wrench in the frame's own axes, z being the surface's normal, the rectangle 2 a by 2 b and
    ``m = mu cos(pi / 4)``: ``f_z`` > 0, sliding ``m f_z -+ f_x``, ``m f_z -+ f_y``, the centre of pressure
    (:class:`CenterOfPressure`), and torsion about the normal, for all signs s, t::

        m (a + b) f_z - m_z - s (b f_x + m m_x) - t (a f_y + m m_y)
        m (a + b) f_z + m_z - s (b f_x - m m_x) - t (a f_y - m m_y)

    These are exactly the sums of forces at the four corners, each within the pyramid of four facets inscribed in its
    friction cone: Caron, Pham and Nakamura, Stability of Surface Contacts for Humanoid Robots, ICRA 2015.

    As a constraint: ``lower=0, upper=inf``. As a cost: ``QuadraticBarrier(0.0, np.inf)``.

    Args:
        frame: name of a surface contact.
        half_size: (a, b) along the frame's x and y, m; default of the parameter ``half_size``.
        friction: default of the parameter ``friction``.
    """

    nr = 17

    def __init__(self, frame: str, half_size: tuple[float, float], friction: float = 0.7) -> None:
        self.frame = frame
        self.parameters = (
            Parameter("half_size", 2, "half lengths of the surface along x and y, m", half_size),
            Parameter("friction", 1, "friction coefficient", friction, "not negative"),
        )

    def expression(self, s: StageSymbols) -> Any:
        """Return the margins.

        Raises:
            InputError: the contact is a point.
        """
        force, moment = _wrench(s, self.frame)
        (fx, fy, fz), (mx, my, mz) = (ca.vertsplit(each) for each in (force, moment))
        a, b = s["half_size"][0], s["half_size"][1]
        m = pyramid_half_width(s["friction"], 4)
        sliding = [m * fz - sign * each for each in (fx, fy) for sign in (1, -1)]
        pressure = [arm * fz - sign * each for arm, each in ((a, my), (b, mx)) for sign in (1, -1)]
        torsion = [
            m * (a + b) * fz - turn * mz - across * (b * fx + turn * m * mx) - along * (a * fy + turn * m * my)
            for turn in (1, -1)
            for across in (1, -1)
            for along in (1, -1)
        ]
        return ca.vertcat(fz, *sliding, *pressure, *torsion)


def _wrench(s: StageSymbols, frame: str) -> tuple[Any, Any]:
    """Return force and moment of a surface contact in the frame's own axes."""
    wrench, back = s.force(frame), s.placement(frame).rotation.T
    if wrench.shape[0] != 6:
        raise InputError("frame", f"{frame}, a point contact", "a surface contact")
    return back @ wrench[:3], back @ wrench[3:]
