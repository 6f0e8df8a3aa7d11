"""Geometric mechanics on matrix Lie groups: equations of motion, invariants, integrators, phases and control.

    reduction     Euler-Poincare and Lie-Poisson equations on any group, momentum maps, Noether's theorem
    integrators   Lie-group Runge-Kutta, variational, and a comparison of their drifts
    rollout       compiled steps, thousands in a call
    rigid_body    free bodies and heavy tops as Euler-Poincare systems
    tops          closed forms: torque-free body, Poinsot, Lagrange's top
    multibody     floating-base and centroidal dynamics
    phases        cat, beanie, three links, Montgomery's formula
    underwater    added mass, damping, buoyancy
    quadrotor     geometric control on SE(3), and an Euler-angle PID

:mod:`lgmpc.mechanics.quadrotor` is not exported here.

Sections cited as "chapter 4.x" are those of the lecture notes "Geometric mechanics on SE(3): Euler-Poincare equations,
floating-base dynamics and Lie-Poisson structure" (rigid-body dynamics, part 4-4, in Chinese).
"""

from lgmpc.mechanics.checks import check_inertia
from lgmpc.mechanics.integrators.comparison import compare_integrators, drift_table
from lgmpc.mechanics.integrators.variational import discrete_euler_poincare, moser_veselov
from lgmpc.mechanics.multibody.articulated import ArticulatedBody
from lgmpc.mechanics.multibody.centroidal import CentroidalTerms, centroidal_terms, wrench_about
from lgmpc.mechanics.multibody.floating_base import EquationsOfMotion, FloatingBaseDynamics
from lgmpc.mechanics.phases.cat import Cat
from lgmpc.mechanics.phases.connection import Connection
from lgmpc.mechanics.phases.elroy import Beanie
from lgmpc.mechanics.phases.rigid_body import rigid_body_phase
from lgmpc.mechanics.phases.three_link import ThreeLink
from lgmpc.mechanics.reduction.euler_poincare import EulerPoincare, LeftEulerPoincare, RightEulerPoincare, munthe_kaas
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
from lgmpc.mechanics.reduction.terms import Advected, Motion, Symbols
from lgmpc.mechanics.rigid_body import HEIGHT, UP, SpatialInertia, free_body, heavy_top, torque_free_body
from lgmpc.mechanics.tops.benchmarks import BRULS_TOP, SIMO_WONG_TOP, HeavyTopBenchmark
from lgmpc.mechanics.tops.lagrange_top import LagrangeTop
from lgmpc.mechanics.tops.poinsot import Poinsot
from lgmpc.mechanics.tops.torque_free import EulerTop, symmetric_top_precession
from lgmpc.mechanics.underwater import UnderwaterVehicle, speed_under_force, spheroid_added_mass, terminal_speed

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
    "UnderwaterVehicle",
    "body_momentum",
    "centroidal_terms",
    "check_inertia",
    "compare_integrators",
    "conserved_dimension",
    "discrete_euler_poincare",
    "drift_table",
    "extended_poses",
    "extended_poses_dual",
    "free_body",
    "heavy_top",
    "moser_veselov",
    "munthe_kaas",
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
