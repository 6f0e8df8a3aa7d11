"""Integrators of Euler-Poincare systems: Runge-Kutta on matrix entries, variational, and a comparison.

    body = torque_free_body(np.diag([1.0, 2.0, 3.0]))
    motion = body.simulate(np.eye(3), np.array([1.0, 0.0, 0.8]), step=0.1, steps=10_000, method=moser_veselov)
    print(drift_table(compare_integrators(body, np.eye(3), np.array([1.0, 0.0, 0.8]), step=0.1, steps=10_000)))

The variational integrator of multibody robots is :class:`lgmpc.actions.Variational`.
"""
