"""Residuals for costs and constraints."""

from lgmpc.costs.library.collision import ShapePairDistance
from lgmpc.costs.library.dynamics import (
    CentroidalMomentum,
    CoMPosition,
    CoMVelocity,
    ContactControlGravity,
    Control,
    ControlGravity,
    JointAcceleration,
    JointPosition,
    StateError,
)
from lgmpc.costs.library.forces import CenterOfPressure, ContactForce, FrictionCone, WrenchCone
from lgmpc.costs.library.frames import (
    FramePlacement,
    FrameRotation,
    FrameRotationMatrix,
    FrameTranslation,
    FrameVelocity,
)

__all__ = [
    "CenterOfPressure",
    "CentroidalMomentum",
    "CoMPosition",
    "CoMVelocity",
    "ContactControlGravity",
    "ContactForce",
    "Control",
    "ControlGravity",
    "FramePlacement",
    "FrameRotation",
    "FrameRotationMatrix",
    "FrameTranslation",
    "FrameVelocity",
    "FrictionCone",
    "JointAcceleration",
    "JointPosition",
    "ShapePairDistance",
    "StateError",
    "WrenchCone",
]
