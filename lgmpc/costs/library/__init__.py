"""Residuals for costs and constraints."""

from lgmpc.costs.library.collision import ShapePairDistance
from lgmpc.costs.library.forces import CenterOfPressure, ContactForce, FrictionCone, WrenchCone
from lgmpc.costs.library.motion import (
    CentroidalMomentum,
    CoMPosition,
    CoMVelocity,
    ContactControlGravity,
    Control,
    FramePlacement,
    FrameRotation,
    FrameRotationMatrix,
    FrameTranslation,
    FrameVelocity,
    JointAcceleration,
    JointPosition,
    StateError,
)

__all__ = [
    "CenterOfPressure",
    "CentroidalMomentum",
    "CoMPosition",
    "CoMVelocity",
    "ContactControlGravity",
    "ContactForce",
    "Control",
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
