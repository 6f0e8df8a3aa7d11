"""Geometric mechanics on matrix Lie groups: equations of motion, invariants, integrators, phases and control.

:mod:`lgmpc.mechanics.quadrotor` and :mod:`lgmpc.mechanics.featherstone` are rooms of their own: import them by name.
"""

from lgmpc.mechanics.articulated import ArticulatedBody
from lgmpc.mechanics.benchmarks import BRULS_TOP, SIMO_WONG_TOP, HeavyTopBenchmark
from lgmpc.mechanics.centroidal import CentroidalTerms, centroidal_terms, wrench_about
from lgmpc.mechanics.euler_poincare import EulerPoincare, LeftEulerPoincare, RightEulerPoincare
from lgmpc.mechanics.floating_base import EquationsOfMotion, FloatingBaseDynamics
from lgmpc.mechanics.groups import SE3, SEMIDIRECT, SO3, LieGroup, extended_poses, translations
from lgmpc.mechanics.lagrange_top import LagrangeTop
from lgmpc.mechanics.lie_poisson import SE3_DUAL, SEMIDIRECT_DUAL, SO3_DUAL, Flow, LiePoisson, extended_poses_dual
from lgmpc.mechanics.momentum_maps import body_momentum, conserved_dimension, spatial_momentum
from lgmpc.mechanics.phases import Beanie, Cat, Connection, ThreeLink, rigid_body_phase
from lgmpc.mechanics.poinsot import Poinsot
from lgmpc.mechanics.rigid_body import HEIGHT, UP, SpatialInertia, check_inertia, free_body, heavy_top, torque_free_body
from lgmpc.mechanics.symmetry import LeftSymmetry
from lgmpc.mechanics.terms import Advected, Motion, Symbols
from lgmpc.mechanics.torque_free import EulerTop, symmetric_top_precession
from lgmpc.mechanics.underwater import UnderwaterVehicle, speed_under_force, spheroid_added_mass, terminal_speed
from lgmpc.mechanics.variational import GroupSystem, Trajectory, compare_integrators, drift_table

__all__ = [
    "BRULS_TOP",
    "HEIGHT",
    "SE3",
    "SE3_DUAL",
    "SEMIDIRECT",
    "SEMIDIRECT_DUAL",
    "SIMO_WONG_TOP",
    "SO3",
    "SO3_DUAL",
    "UP",
    "Advected",
    "ArticulatedBody",
    "Beanie",
    "Cat",
    "CentroidalTerms",
    "Connection",
    "EquationsOfMotion",
    "EulerPoincare",
    "EulerTop",
    "FloatingBaseDynamics",
    "Flow",
    "GroupSystem",
    "HeavyTopBenchmark",
    "LagrangeTop",
    "LeftEulerPoincare",
    "LeftSymmetry",
    "LieGroup",
    "LiePoisson",
    "Motion",
    "Poinsot",
    "RightEulerPoincare",
    "SpatialInertia",
    "Symbols",
    "ThreeLink",
    "Trajectory",
    "UnderwaterVehicle",
    "body_momentum",
    "centroidal_terms",
    "check_inertia",
    "compare_integrators",
    "conserved_dimension",
    "drift_table",
    "extended_poses",
    "extended_poses_dual",
    "free_body",
    "heavy_top",
    "rigid_body_phase",
    "spatial_momentum",
    "speed_under_force",
    "spheroid_added_mass",
    "symmetric_top_precession",
    "terminal_speed",
    "torque_free_body",
    "translations",
    "wrench_about",
]
