"""Exact second derivatives of a stage: of its cost, and of dynamics and path constraint contracted with multipliers.

Gauss-Newton's Hessian leaves out the curvature of residuals and of the dynamics. The Lagrangian of a stage

    L(d) = cost + lambda^T (f (-) x_next) + mu^T g,        d = [dx; du] in tangent coordinates,

has both. An unknown z of the dynamics, ``A z = right``, has the multipliers ``nu = -A^-T L_z``, and the Hessian is
``[I S^T] W [I; S]`` with the Hessian W of ``L + nu^T (A z - right)`` by d and z, and the slopes S of z: second
derivatives of no factorisation and of no solution are formed.
"""

from __future__ import annotations

from typing import cast

import casadi as ca

from lgmpc.actions.base import Action
from lgmpc.actions.implicit import Unknowns
from lgmpc.actions.linearisation import Expandable, StageSteps, at_zero
from lgmpc.compile import Pipeline, PipelineStep

__all__ = ["lagrangian_hessian", "terminal_hessian"]


def lagrangian_hessian(action: Action) -> ca.Function | Pipeline:
    """Return ``(x, u, x_next, p, costate (ndx,), multiplier (ng,)) -> hessian (ndx + nu, ndx + nu)``.

    A pipeline for actions that are expanded in steps: it shares their dynamics' functions.
    """
    if action.expansion is not None:
        return _in_steps(cast(Expandable, action))
    state = action.state
    x, x_next, dx = ca.SX.sym("x", state.nx), ca.SX.sym("x_next", state.nx), ca.SX.sym("dx", state.ndx)
    u, p = ca.SX.sym("u", action.nu), ca.SX.sym("p", action.parameters.size)
    unknowns = Unknowns(keep=True)
    stage = action.stage(state.integrate_symbolic(x, dx), u, p, unknowns)
    costate, multiplier = ca.SX.sym("costate", state.ndx), ca.SX.sym("multiplier", stage.path.value.shape[0])
    gap = state.diff_symbolic(x_next, stage.x_next)
    lagrangian = stage.cost.value + ca.dot(costate, gap) + ca.dot(multiplier, stage.path.value)
    inputs = [x, u, x_next, p, costate, multiplier]
    found = at_zero(unknowns.resolve([*inputs, dx], [unknowns.hessian(lagrangian, dx, u)]), dx)
    names = ["x", "u", "x_next", "p", "costate", "multiplier"]
    return ca.Function(f"{action.name}_lagrangian", inputs, [ca.densify(found[0])], names, ["hessian"])


def terminal_hessian(action: Action) -> ca.Function:
    """Return ``(x, p) -> hessian (ndx, ndx)`` of the terminal cost in tangent coordinates."""
    x, p = ca.SX.sym("x", action.state.nx), ca.SX.sym("p", action.parameters.size)
    dx = ca.SX.sym("dx", action.state.ndx)
    hessian, _ = ca.hessian(action.terminal_cost(action.state.integrate_symbolic(x, dx), p).value, dx)
    found = ca.densify(at_zero([hessian], dx)[0])
    return ca.Function(f"{action.name}_terminal_lagrangian", [x, p], [found], ["x", "p"], ["hessian"])


def _in_steps(action: Expandable) -> Pipeline:
    s = StageSteps(action)
    assert s.equation is not None and s.moved is not None
    dynamics = s.dynamics(s.equation)
    x, u, z, own, stage, size, nz = s.x, s.u, s.z, s.own, s.stage, s.n, s.z.shape[0]
    ng = stage.path.value.shape[0]
    costate, multiplier, nu = ca.SX.sym("costate", s.ndx), ca.SX.sym("multiplier", ng), ca.SX.sym("nu", nz)

    # The items' part, and the dynamics' part without them, which all actions of a robot share.
    of_items = stage.cost.value + ca.dot(multiplier, stage.path.value)
    of_gap = ca.dot(costate, action.state.diff_symbolic(s.x_next, stage.x_next))
    given_items, given = [x, u, z, s.p, multiplier], [x, u, s.x_next, z, own, costate]
    pull_items = s.function("pulled", given_items, at_zero([ca.gradient(of_items, z)], s.dx), of_robot=False)
    pull_gap = s.function("pulled_gap", given, at_zero([ca.gradient(of_gap, z)], s.dx))
    factors = s.equation.system.entries
    entries, one, other = ca.SX.sym("factors", factors.shape[0]), ca.SX.sym("one", nz), ca.SX.sym("other", nz)
    back = s.equation.system.with_entries(entries).solve_transposed(-one - other)
    adjoint = s.function("adjoint", [entries, one, other], [back])

    def curvature(lagrangian: ca.SX) -> list[ca.SX]:
        whole, _ = ca.hessian(lagrangian, ca.vertcat(s.d, z))
        return [ca.densify(m) for m in at_zero([whole[:size, :size], whole[size:, :size], whole[size:, size:]], s.dx)]

    items = s.function("curvature", given_items, curvature(of_items), of_robot=False)
    motion = s.function("curvature_of_motion", [*given, nu], curvature(of_gap + ca.dot(nu, s.moved.residual)))
    names = ("direct_hessian", "mixed", "inner")
    by_items, by_motion = (tuple(f"{name}_of_{part}" for name in names) for part in ("items", "motion"))

    def summed(k: int, rows: int, columns: int) -> PipelineStep:
        """Return the sum of both parts of a matrix, column after column."""
        left, right = ca.SX.sym("left", rows), ca.SX.sym("right", rows)
        add = s.function(f"sum_{rows}", [left, right], [left + right])
        return PipelineStep(add, (by_items[k], by_motion[k]), (names[k],), columns)

    steps = (
        *dynamics,
        PipelineStep(pull_items, ("x", "u", "z", "p", "multiplier"), ("pulled",)),
        PipelineStep(pull_gap, ("x", "u", "x_next", "z", "p", "costate"), ("pulled_gap",)),
        PipelineStep(adjoint, ("factors", "pulled", "pulled_gap"), ("nu",)),
        PipelineStep(items, ("x", "u", "z", "p", "multiplier"), by_items),
        PipelineStep(motion, ("x", "u", "x_next", "z", "p", "costate", "nu"), by_motion),
        summed(0, size, size),
        summed(1, nz, size),
        summed(2, nz, nz),
        *s.through_slopes(list(range(nz)), ca.SX.ones(nz, size), ca.SX.ones(nz, nz), entries="mixed"),
    )
    inputs = {"x": action.state.nx, "u": action.nu, "x_next": action.state.nx, "p": action.parameters.size}
    inputs |= {"costate": s.ndx, "multiplier": ng}
    return Pipeline(f"{action.name}_lagrangian", inputs, steps, {"hessian": "hessian"})
