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

from lgmpc.mechanics.checks import check_inertia
from lgmpc.mechanics.connection import Connection
from lgmpc.mechanics.euler_poincare import (
    Advected,
    EulerPoincare,
    Motion,
    Symbols,
    munthe_kaas,
)
from lgmpc.mechanics.groups import SE3, SEMIDIRECT, SO3, LieGroup, body_momentum, spatial_momentum
from lgmpc.mechanics.integrators import discrete_euler_poincare, moser_veselov
from lgmpc.mechanics.lagrange_top import LagrangeTop
from lgmpc.mechanics.lie_poisson import SE3_DUAL, SEMIDIRECT_DUAL, SO3_DUAL, LiePoisson
from lgmpc.mechanics.phases import Cat, ThreeLink
from lgmpc.mechanics.rigid_body import HEIGHT, UP, SpatialInertia, free_body, heavy_top, torque_free_body
from lgmpc.mechanics.symmetry import LeftSymmetry, conserved_dimension
from lgmpc.mechanics.torque_free import EulerTop, Poinsot
from lgmpc.mechanics.underwater import UnderwaterVehicle, spheroid_added_mass

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
    "Cat",
    "Connection",
    "EulerPoincare",
    "EulerTop",
    "LagrangeTop",
    "LeftSymmetry",
    "LieGroup",
    "LiePoisson",
    "Motion",
    "Poinsot",
    "SpatialInertia",
    "Symbols",
    "ThreeLink",
    "UnderwaterVehicle",
    "body_momentum",
    "check_inertia",
    "conserved_dimension",
    "discrete_euler_poincare",
    "free_body",
    "heavy_top",
    "moser_veselov",
    "munthe_kaas",
    "spatial_momentum",
    "spheroid_added_mass",
    "torque_free_body",
]
