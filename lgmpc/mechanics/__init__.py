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
from lgmpc.mechanics.integrators import (
    compare_integrators,
    discrete_euler_poincare,
    drift_table,
    moser_veselov,
    munthe_kaas,
)
from lgmpc.mechanics.multibody import (
    ArticulatedBody,
    CentroidalTerms,
    EquationsOfMotion,
    FloatingBaseDynamics,
    centroidal_terms,
    wrench_about,
)
from lgmpc.mechanics.phases import Beanie, Cat, Connection, ThreeLink, rigid_body_phase
from lgmpc.mechanics.reduction import (
    SE3,
    SE3_DUAL,
    SEMIDIRECT,
    SEMIDIRECT_DUAL,
    SO3,
    SO3_DUAL,
    Advected,
    EulerPoincare,
    Flow,
    LeftEulerPoincare,
    LeftSymmetry,
    LieGroup,
    LiePoisson,
    Motion,
    RightEulerPoincare,
    Symbols,
    body_momentum,
    conserved_dimension,
    extended_poses,
    extended_poses_dual,
    spatial_momentum,
    translations,
)
from lgmpc.mechanics.rigid_body import HEIGHT, UP, SpatialInertia, free_body, heavy_top, torque_free_body
from lgmpc.mechanics.tops import (
    BRULS_TOP,
    SIMO_WONG_TOP,
    EulerTop,
    HeavyTopBenchmark,
    LagrangeTop,
    Poinsot,
    symmetric_top_precession,
)
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
