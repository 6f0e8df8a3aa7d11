"""State spaces: the manifolds of trajectories, with displacements and differences of their points.

``integrate(x, dx) = x (+) dx`` and ``diff(x0, x1) = x1 (-) x0`` with ``diff(x, integrate(x, dx)) = dx`` inside the
injectivity radius (rotations below half a turn); ``Jintegrate -> (d/dx, d/ddx)``, ``Jdiff -> (d/dx0, d/dx1)``, all
between tangent spaces in body axes. ``integrate_symbolic`` and ``diff_symbolic`` act on CasADi expressions.
"""

from lgmpc.state.base import ProductState as ProductState, State as State, StateVector as StateVector
from lgmpc.state.configuration import (
    difference_symbolic as difference_symbolic,
    integrate_configuration_symbolic as integrate_configuration_symbolic,
)
from lgmpc.state.multibody import StateMultibody as StateMultibody
