"""A rigid body on SE(3)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from lgmpc.actions.full_body import FreeForwardDynamics
from lgmpc.actions.integrators import Integrator
from lgmpc.actions.multibody import MultibodyAction
from lgmpc.actions.variational import Variational
from lgmpc.costs import ConstraintItem, CostItem
from lgmpc.errors import InputError
from lgmpc.typing import GRAVITY, Array, instance, numbers

__all__ = ["RigidBody", "RigidBodyAction"]

_EARTH = (0.0, 0.0, -GRAVITY)


class RigidBody(FreeForwardDynamics):
    r"""Newton-Euler equations of one rigid body, about any point of it.

        G v' = ad_v^T G v + Ad_g^T w_gravity + B u,        G = [ m 1     -m [c]     ]
                                                               [ m [c]   I - m [c]^2 ]

    v = [linear; angular] is the velocity of the body's origin in its own axes, c the centre of mass from there, I the
    inertia about the centre of mass. The symbol ``body`` names its frame, for residuals of frames. The state is
    ``x = [position, quaternion x y z w, v]`` (13,).

    Parameters: ``drag_linear``, ``drag_quadratic`` (6,), see :class:`~lgmpc.actions.FreeForwardDynamics`.

    Args:
        mass: m, kg.
        inertia: (3, 3) I, or (3,) its principal moments along the body's axes, kg.m2.
        center_of_mass: (3,) c, body frame, m.
        actuation: (6, nu) B, the wrench [force; moment] at the body's origin, body axes, of each unit control (see
            :func:`~lgmpc.actions.thrusters`); unless given, the identity: u is the wrench, N and N.m.
        gravity: (3,) world axes, m/s2.

    Raises:
        InputError: a mass that is not positive, an inertia that no body has, or arrays of wrong shape or not finite.
    """

    def __init__(
        self,
        mass: float,
        inertia: ArrayLike,
        center_of_mass: ArrayLike = (0.0, 0.0, 0.0),
        actuation: ArrayLike | None = None,
        gravity: ArrayLike = _EARTH,
    ) -> None:
        if not 0.0 < float(numbers("mass", mass, ())) < math.inf:
            raise InputError("mass", mass, "a finite number above 0 kg")
        tensor = _inertia(inertia)
        model = pin.Model()
        model.name = "rigid_body"
        root = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root_joint")
        spatial = pin.Inertia(mass, numbers("center_of_mass", center_of_mass, (3,), finite=True), tensor)
        model.appendBodyToJoint(root, spatial, pin.SE3.Identity())
        model.addBodyFrame("body", root, pin.SE3.Identity(), 0)
        model.gravity = pin.Motion(numbers("gravity", gravity, (3,), finite=True), np.zeros(3))
        super().__init__(model, np.eye(6) if actuation is None else actuation)


class RigidBodyAction(MultibodyAction):
    """A rigid body over an interval.

    Args:
        name: a C identifier; part of the names of the compiled functions.
        body: the rigid body.
        costs: evaluated at the interval's beginning; those of the state alone are the terminal cost.
        constraints: evaluated at the interval's beginning.
        integrator: the variational one unless given, which conserves the momentum maps; semi-implicit Euler and
            :class:`~lgmpc.actions.RungeKutta4` are alternatives.

    Raises:
        InputError: a name that is no identifier, or two items of one name.
    """

    def __init__(
        self,
        name: str,
        body: RigidBody,
        costs: Sequence[CostItem] = (),
        constraints: Sequence[ConstraintItem] = (),
        integrator: Integrator | None = None,
    ) -> None:
        instance("body", body, RigidBody, "a RigidBody")
        super().__init__(name, body, costs, constraints, Variational() if integrator is None else integrator)


def _inertia(value: ArrayLike) -> Array:
    array = numbers("inertia", value)
    tensor: Array = np.diag(array) if array.shape == (3,) else array
    if tensor.shape != (3, 3) or not np.isfinite(tensor).all():
        raise InputError("inertia", f"shape {array.shape}", "finite, shape (3, 3), or (3,) principal moments")
    if not np.allclose(tensor, tensor.T, rtol=0.0, atol=1e-12 * np.abs(tensor).max()):
        raise InputError("inertia", "a matrix that is not symmetric", "a symmetric matrix")
    moments = np.linalg.eigvalsh(tensor)
    # The largest moment is at most the sum of the others: each is a sum of squared distances from an axis.
    if not (moments[0] > 0.0 and moments[2] <= (moments[0] + moments[1]) * (1.0 + 1e-9)):
        expected = "positive ones, none above the sum of the two others"
        raise InputError("inertia", f"principal moments {np.array2string(moments, precision=6)}", expected)
    return tensor
