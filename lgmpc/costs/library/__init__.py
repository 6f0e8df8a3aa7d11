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
    JointEffort,
    JointPosition,
    StateError,
)
from lgmpc.costs.library.forces import CenterOfPressure, ContactForce, FrictionCone, SmoothFrictionCone, WrenchCone
from lgmpc.costs.library.frames import (
    FramePairDistance,
    FramePlacement,
    FrameRotation,
    FrameRotationMatrix,
    FrameRotationPsi,
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
    "FramePairDistance",
    "FramePlacement",
    "FrameRotation",
    "FrameRotationMatrix",
    "FrameRotationPsi",
    "FrameTranslation",
    "FrameVelocity",
    "FrictionCone",
    "JointAcceleration",
    "JointEffort",
    "JointPosition",
    "ShapePairDistance",
    "SmoothFrictionCone",
    "StateError",
    "WrenchCone",
]
