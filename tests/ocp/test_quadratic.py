from __future__ import annotations

import numpy as np
import pytest

from lgmpc.compile import BatchKernel
from lgmpc.ocp import KktResidual, OcpQp, ShootingProblem, SubproblemFunctions, kkt_residual
from lgmpc.ocp.horizon import advance


@pytest.fixture
def functions(problem: ShootingProblem) -> SubproblemFunctions:
    return SubproblemFunctions(problem)


@pytest.fixture
def qp(problem: ShootingProblem, functions: SubproblemFunctions) -> OcpQp:
    rng = np.random.default_rng(0)
    trajectory = problem.rollout(rng.standard_normal((5, 12)))
    functions.xs[:] = trajectory.xs + 0.1 * rng.standard_normal((6, 9))
    functions.us[:] = trajectory.us
    functions.linearize()
    return functions.qp


def test_one_call_gives_every_stage(problem: ShootingProblem, functions: SubproblemFunctions, qp: OcpQp) -> None:
    xs, us = functions.xs, functions.us
    stage = problem.action.quadratic_function
    for k in range(5):
        for name, value in zip(stage.name_out(), stage(xs[k], us[k], xs[k + 1], problem.parameters[k]), strict=True):
            np.testing.assert_allclose(qp.dense(name)[k], value.full(), rtol=1e-13, atol=1e-13, err_msg=f"{name} {k}")
    terminal = problem.action.terminal_quadratic_function
    for name, value in zip(terminal.name_out(), terminal(xs[5], problem.parameters[5]), strict=True):
        np.testing.assert_allclose(qp.dense_terminal(name), value.full(), rtol=1e-13)


def test_structural_zeros_are_not_stored(qp: OcpQp) -> None:
    blocks = qp.structure.blocks
    assert blocks["S"].rows.size == blocks["C"].rows.size == 0
    assert blocks["Q"].rows.size == 9 and blocks["R"].rows.size == 12
    assert blocks["D"].rows.size == 4 * (4 + 1) * 3  # of each contact the facets and the force along the normal
    vectors = [name for name in blocks if len(name) > 1 or name.islower()]
    stored = sum(blocks[name].rows.size for name in ("A", "B", "Q", "R", "D", *vectors))
    assert qp.structure.size == stored


def dense_kkt(qp: OcpQp, dxs, dus, costates, multipliers) -> KktResidual:
    """The definition, with dense matrices, stage by stage."""
    m = {name: qp.dense(name) for name in ("A", "B", "b", "Q", "S", "R", "q", "r", "C", "D", "lower", "upper")}
    stationarity, gaps, outside, loose = [], [], [], []
    for k in range(qp.structure.nodes):
        gu = m["S"][k] @ dxs[k] + m["R"][k] @ dus[k] + m["r"][k][:, 0]
        stationarity.append(gu + m["B"][k].T @ costates[k] + m["D"][k].T @ multipliers[k])
        if k > 0:
            gx = m["Q"][k] @ dxs[k] + m["S"][k].T @ dus[k] + m["q"][k][:, 0]
            stationarity.append(gx + m["A"][k].T @ costates[k] + m["C"][k].T @ multipliers[k] - costates[k - 1])
        gaps.append(m["A"][k] @ dxs[k] + m["B"][k] @ dus[k] + m["b"][k][:, 0] - dxs[k + 1])
        row = m["C"][k] @ dxs[k] + m["D"][k] @ dus[k]
        lower, upper = m["lower"][k][:, 0], m["upper"][k][:, 0]
        outside += [np.maximum(lower - row, 0.0), np.maximum(row - upper, 0.0)]
        loose.append(np.minimum(np.maximum(multipliers[k], 0.0), upper - row))
        loose.append(np.minimum(np.maximum(-multipliers[k], 0.0), row - lower))
    last = qp.dense_terminal("Q") @ dxs[-1] + qp.dense_terminal("q")[:, 0] - costates[-1]
    stationarity.append(last)
    largest = [max(float(np.abs(v).max()) for v in values) for values in (stationarity, gaps, outside)]
    return KktResidual(*largest, max(float(v.max()) for v in loose))


def measured_kkt(qp: OcpQp, point) -> KktResidual:
    dxs, dus, costates, multipliers = point
    return kkt_residual(qp, costates, multipliers, (dxs, dus))


def test_kkt_residual_is_its_definition(qp: OcpQp) -> None:
    rng = np.random.default_rng(2)
    point = [rng.standard_normal(shape) for shape in ((6, 9), (5, 12), (5, 9), (5, 20))]
    measured = measured_kkt(qp, point)
    expected = dense_kkt(qp, *point)
    for name in ("stationarity", "dynamics", "constraint", "complementarity"):
        assert getattr(measured, name) == pytest.approx(getattr(expected, name), rel=1e-12), name
    assert measured.largest == max(vars(measured).values())


@pytest.mark.parametrize("which", range(4))
def test_kkt_residual_of_nan_is_nan(qp: OcpQp, which: int) -> None:
    point = [np.zeros(shape) for shape in ((6, 9), (5, 12), (5, 9), (5, 20))]
    point[which][2, 3] = np.nan
    measured = measured_kkt(qp, point)
    assert all(np.isnan(value) for value in vars(measured).values()) and np.isnan(measured.largest)


def test_advance_moves_along_the_line_to_the_next_node(problem: ShootingProblem) -> None:
    xs, moved = np.random.default_rng(3).standard_normal((6, 9)), np.zeros((5, 9))
    BatchKernel(advance(problem.state)).bind(5, x=xs, x_next=xs[1:], fraction=np.array([0.25]), moved=moved)()
    np.testing.assert_allclose(moved, 0.75 * xs[:-1] + 0.25 * xs[1:], rtol=0, atol=1e-15)
