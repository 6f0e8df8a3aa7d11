"""Reduction by symmetry: systems on any matrix group, their equations, brackets and conserved momenta."""

from lgmpc.mechanics.reduction.euler_poincare import EulerPoincare, LeftEulerPoincare, Method, RightEulerPoincare
from lgmpc.mechanics.reduction.groups import SE3, SEMIDIRECT, SO3, LieGroup, extended_poses, translations
from lgmpc.mechanics.reduction.lie_poisson import (
    SE3_DUAL,
    SEMIDIRECT_DUAL,
    SO3_DUAL,
    Flow,
    LiePoisson,
    extended_poses_dual,
)
from lgmpc.mechanics.reduction.momentum_maps import body_momentum, conserved_dimension, spatial_momentum
from lgmpc.mechanics.reduction.symmetry import LeftSymmetry
from lgmpc.mechanics.reduction.terms import Advected, Expression, Motion, Symbols

__all__ = [
    "SE3",
    "SE3_DUAL",
    "SEMIDIRECT",
    "SEMIDIRECT_DUAL",
    "SO3",
    "SO3_DUAL",
    "Advected",
    "EulerPoincare",
    "Expression",
    "Flow",
    "LeftEulerPoincare",
    "LeftSymmetry",
    "LieGroup",
    "LiePoisson",
    "Method",
    "Motion",
    "RightEulerPoincare",
    "Symbols",
    "body_momentum",
    "conserved_dimension",
    "extended_poses",
    "extended_poses_dual",
    "spatial_momentum",
    "translations",
]
