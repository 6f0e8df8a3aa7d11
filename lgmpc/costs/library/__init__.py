"""Residuals for costs and constraints."""

from lgmpc.costs.library.collision import ShapePairDistance as ShapePairDistance
from lgmpc.costs.library.forces import (
    CenterOfPressure as CenterOfPressure,
    ContactForce as ContactForce,
    FrictionCone as FrictionCone,
    WrenchCone as WrenchCone,
)
from lgmpc.costs.library.motion import (
    CentroidalMomentum as CentroidalMomentum,
    CoMPosition as CoMPosition,
    ContactControlGravity as ContactControlGravity,
    Control as Control,
    FramePlacement as FramePlacement,
    FrameRotation as FrameRotation,
    FrameRotationMatrix as FrameRotationMatrix,
    FrameTranslation as FrameTranslation,
    FrameVelocity as FrameVelocity,
    JointAcceleration as JointAcceleration,
    JointPosition as JointPosition,
    StateError as StateError,
)
