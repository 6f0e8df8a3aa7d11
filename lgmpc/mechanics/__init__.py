"""Geometric mechanics on matrix Lie groups: equations of motion, invariants, integrators, phases and control."""

from lgmpc.mechanics.euler_poincare import (
    Advected,
    EulerPoincare,
    LeftEulerPoincare,
    Motion,
    RightEulerPoincare,
    Symbols,
)
from lgmpc.mechanics.groups import SE3, SEMIDIRECT, SO3, LieGroup, extended_poses, translations
from lgmpc.mechanics.lie_poisson import SE3_DUAL, SEMIDIRECT_DUAL, SO3_DUAL, Flow, LiePoisson, extended_poses_dual
from lgmpc.mechanics.momentum_maps import body_momentum, conserved_dimension, spatial_momentum
from lgmpc.mechanics.rigid_body import HEIGHT, UP, SpatialInertia, check_inertia, free_body, heavy_top, torque_free_body
from lgmpc.mechanics.symmetry import LeftSymmetry

__all__ = [
    "HEIGHT",
    "SE3",
    "SE3_DUAL",
    "SEMIDIRECT",
    "SEMIDIRECT_DUAL",
    "SO3",
    "SO3_DUAL",
    "UP",
    "Advected",
    "EulerPoincare",
    "Flow",
    "LeftEulerPoincare",
    "LeftSymmetry",
    "LieGroup",
    "LiePoisson",
    "Motion",
    "RightEulerPoincare",
    "SpatialInertia",
    "Symbols",
    "body_momentum",
    "check_inertia",
    "conserved_dimension",
    "extended_poses",
    "extended_poses_dual",
    "free_body",
    "heavy_top",
    "spatial_momentum",
    "torque_free_body",
    "translations",
]
