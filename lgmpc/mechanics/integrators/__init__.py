"""Integrators of Euler-Poincare systems: Runge-Kutta on matrix entries, variational, and a comparison.

    body = torque_free_body(np.diag([1.0, 2.0, 3.0]))
    motion = body.simulate(np.eye(3), np.array([1.0, 0.0, 0.8]), step=0.1, steps=10_000, method=moser_veselov)
    print(drift_table(compare_integrators(body, np.eye(3), np.array([1.0, 0.0, 0.8]), step=0.1, steps=10_000)))

The variational integrator of multibody robots is :class:`lgmpc.actions.Variational`.
"""

from lgmpc.mechanics.integrators.comparison import Drift, compare_integrators, drift_table
from lgmpc.mechanics.integrators.runge_kutta import matrix_runge_kutta, projected_runge_kutta
from lgmpc.mechanics.integrators.variational import discrete_euler_poincare, moser_veselov
from lgmpc.mechanics.reduction.euler_poincare import munthe_kaas

__all__ = [
    "Drift",
    "compare_integrators",
    "discrete_euler_poincare",
    "drift_table",
    "matrix_runge_kutta",
    "moser_veselov",
    "munthe_kaas",
    "projected_runge_kutta",
]
