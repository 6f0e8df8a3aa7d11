"""A rigid body on SE(3), about any point of it."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from lgmpc.actions import FreeForwardDynamics, MultibodyAction, Variational
from lgmpc.actions.integrators import Integrator


class RigidBody(FreeForwardDynamics):
    """Newton-Euler equations of one body of a mass, an inertia about its centre of mass, and that centre."""

    def __init__(
        self, mass, inertia, center_of_mass=(0.0, 0.0, 0.0), actuation=None, gravity=(0.0, 0.0, -9.81)
    ) -> None:
        tensor = np.diag(inertia) if np.ndim(inertia) == 1 else np.asarray(inertia, dtype=np.float64)
        model = pin.Model()
        model.name = "rigid_body"
        root = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root_joint")
        spatial = pin.Inertia(mass, np.array(center_of_mass, dtype=np.float64), tensor)
        model.appendBodyToJoint(root, spatial, pin.SE3.Identity())
        model.addBodyFrame("body", root, pin.SE3.Identity(), 0)
        model.gravity = pin.Motion(np.array(gravity, dtype=np.float64), np.zeros(3))
        super().__init__(model, np.eye(6) if actuation is None else actuation)


class RigidBodyAction(MultibodyAction):
    """A rigid body over an interval, by the variational integrator unless another is given."""

    def __init__(self, name, body, costs=(), constraints=(), integrator: Integrator | None = None) -> None:
        super().__init__(name, body, costs, constraints, Variational() if integrator is None else integrator)
