"""Lie-group variational integrators beside Runge-Kutta methods, for bodies on SO(3) and SE(3) (chapter 4.18).

    body = GroupSystem(np.diag([1.0, 2.0, 3.0]))
    start = body.start(np.eye(3), [1.0, 0.0, 0.8])
    motion = simulate(moser_veselov(body), body, start, h=0.1, duration=1000.0)
    print(drift_table(compare_integrators(body, start, h=0.1, duration=1000.0)))

Robots of many bodies have their variational integrator in :class:`lgmpc.actions.Variational`.
"""

from lgmpc.mechanics.variational.comparison import Drift, compare_integrators, drift_table
from lgmpc.mechanics.variational.integrators import (
    discrete_euler_poincare,
    lie_runge_kutta,
    matrix_runge_kutta,
    moser_veselov,
    simulate,
)
from lgmpc.mechanics.variational.system import GroupSystem, Potential, Trajectory, Wrench, heavy_top_system

__all__ = [
    "Drift",
    "GroupSystem",
    "Potential",
    "Trajectory",
    "Wrench",
    "compare_integrators",
    "discrete_euler_poincare",
    "drift_table",
    "heavy_top_system",
    "lie_runge_kutta",
    "matrix_runge_kutta",
    "moser_veselov",
    "simulate",
]
