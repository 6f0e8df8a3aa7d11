"""Geometric mechanics on matrix Lie groups: equations of motion, invariants, integrators, phases and control.

    groups, euler_poincare, lie_poisson   equations of motion and brackets on any group, momentum maps
    symmetry         Noether's theorem
    integrators      Runge-Kutta and variational
    rigid_body       free bodies and heavy tops as Euler-Poincare systems
    torque_free, lagrange_top   closed forms of tops, Poinsot's construction
    connection, phases          rotation by changes of shape: cat, three links
    underwater       added mass, damping, buoyancy
    quadrotor        geometric control on SE(3), and control by Euler angles (not exported here)

Robots of many bodies are the subject of :class:`lgmpc.robot.symbolic.SymbolicModel`.

Sections cited as "chapter 4.x" are those of the lecture notes "Geometric mechanics on SE(3): Euler-Poincare equations,
floating-base dynamics and Lie-Poisson structure" (rigid-body dynamics, part 4-4, in Chinese).
"""

from lgmpc.mechanics.checks import check_inertia as check_inertia
from lgmpc.mechanics.connection import Connection as Connection
from lgmpc.mechanics.euler_poincare import (
    Advected as Advected,
    EulerPoincare as EulerPoincare,
    Motion as Motion,
    Symbols as Symbols,
    munthe_kaas as munthe_kaas,
)
from lgmpc.mechanics.groups import (
    SE3 as SE3,
    SEMIDIRECT as SEMIDIRECT,
    SO3 as SO3,
    LieGroup as LieGroup,
    body_momentum as body_momentum,
    spatial_momentum as spatial_momentum,
)
from lgmpc.mechanics.integrators import (
    discrete_euler_poincare as discrete_euler_poincare,
    moser_veselov as moser_veselov,
)
from lgmpc.mechanics.lagrange_top import LagrangeTop as LagrangeTop
from lgmpc.mechanics.lie_poisson import (
    SE3_DUAL as SE3_DUAL,
    SEMIDIRECT_DUAL as SEMIDIRECT_DUAL,
    SO3_DUAL as SO3_DUAL,
    LiePoisson as LiePoisson,
)
from lgmpc.mechanics.phases import Cat as Cat, ThreeLink as ThreeLink
from lgmpc.mechanics.rigid_body import (
    HEIGHT as HEIGHT,
    UP as UP,
    SpatialInertia as SpatialInertia,
    free_body as free_body,
    heavy_top as heavy_top,
    torque_free_body as torque_free_body,
)
from lgmpc.mechanics.symmetry import LeftSymmetry as LeftSymmetry, conserved_dimension as conserved_dimension
from lgmpc.mechanics.torque_free import EulerTop as EulerTop, Poinsot as Poinsot
from lgmpc.mechanics.underwater import (
    UnderwaterVehicle as UnderwaterVehicle,
    spheroid_added_mass as spheroid_added_mass,
)
