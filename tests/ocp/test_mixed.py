"""Problems whose intervals differ."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from lgmpc.actions import Action, CentroidalAction
from lgmpc.costs import Bounded, LeastSquares, Parameter, ParameterLayout
from lgmpc.errors import InputError
from lgmpc.ocp import OcpQp, ShootingFunctions, ShootingProblem, SubproblemFunctions, Trajectory
from lgmpc.state import StateVector


class Pendulum(Action):
    """With torque, or without control if ``kick`` is given: an impact that removes a fraction of the speed."""

    def __init__(self, kick: bool) -> None:
        self.name = "kicked" if kick else "driven"
        self.kick = kick
        self.state = StateVector(2)
        self.nu = 0 if kick else 1
        own = Parameter("restitution", 1, "") if kick else Parameter("limits", 2, "of angle and torque")
        self.parameters = ParameterLayout(own, Parameter("weight", 2, "of the state"))

    def step(self, x, u, p):
        if self.kick:
            return ca.vertcat(x[0], p[0] * x[1])
        return ca.vertcat(x[0] + 0.1 * x[1], x[1] + 0.1 * (u[0] - ca.sin(x[0])))

    def cost(self, x, u, p):
        weight = self.parameters.split(p)["weight"]
        return LeastSquares(ca.vertcat(x, u), ca.vertcat(weight, *([0.1] * self.nu)))

    def terminal_cost(self, x, p):
        return LeastSquares(x, 10.0 * self.parameters.split(p)["weight"])

    def constraint(self, x, u, p):
        if self.kick:
            return Bounded.stack()
        limits = self.parameters.split(p)["limits"]
        return Bounded(ca.vertcat(x[0], u), -limits, limits)


@pytest.fixture
def problem() -> ShootingProblem:
    driven, kicked = Pendulum(False), Pendulum(True)
    problem = ShootingProblem([driven] * 3 + [kicked] + [driven] * 2, terminal=kicked)
    problem.set("restitution", 0.5)
    problem.set("limits", [2.0, 3.0])
    problem.set("weight", np.arange(14.0).reshape(7, 2) + 1.0)
    problem.set_initial_state([0.3, -0.4])
    return problem


def test_parameters_find_their_place_at_every_node(problem: ShootingProblem) -> None:
    assert problem.parameters.shape == (7, 4)
    np.testing.assert_array_equal(problem.parameters[0], [2.0, 3.0, 1.0, 2.0])
    np.testing.assert_array_equal(problem.parameters[3], [0.5, 7.0, 8.0, 0.0])
    np.testing.assert_array_equal(problem.parameters[6], [0.5, 13.0, 14.0, 0.0])
    problem.set("weight", [[5.0, 6.0], [7.0, 8.0]], nodes=[1, 3])
    np.testing.assert_array_equal(problem.parameters[1], [2.0, 3.0, 5.0, 6.0])
    np.testing.assert_array_equal(problem.parameters[3], [0.5, 7.0, 8.0, 0.0])
    with pytest.raises(InputError, match="store it differently"):
        problem.view("weight")
    with pytest.raises(InputError, match="restitution"):
        problem.set("restitution", 0.1, nodes=[0])
    with pytest.raises(InputError, match="nodes: got 7"):
        problem.set("weight", 0.1, nodes=[7])
    with pytest.raises(InputError, match="Did you mean restitution"):
        problem.set("restituton", 0.1)
    with pytest.raises(InputError, match="actions that differ"):
        _ = problem.action


def test_bad_sequences_are_named() -> None:
    driven = Pendulum(False)
    with pytest.raises(InputError, match="empty sequence"):
        ShootingProblem([])
    with pytest.raises(InputError, match="nodes: got 3; expected 2"):
        ShootingProblem([driven] * 2, 3)
    with pytest.raises(InputError, match="nodes: got None"):
        ShootingProblem(driven)
    with pytest.raises(InputError, match=r"actions\[1\]: got 'centroidal_1x4' on nx = 9"):
        ShootingProblem([driven, CentroidalAction(1, 4)])
    with pytest.raises(InputError, match="terminal: got 'centroidal"):
        ShootingProblem([driven], terminal=CentroidalAction(1, 4))


def point(problem: ShootingProblem) -> Trajectory:
    rng = np.random.default_rng(0)
    xs, us = rng.standard_normal((7, 2)), rng.standard_normal((6, 1))
    xs[0], us[3] = problem.x0, 0.0
    return Trajectory(xs, us)


@pytest.mark.parametrize("jit", ["1", "0"])
def test_expansion_is_that_of_each_action(problem: ShootingProblem, jit: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LGMPC_JIT", jit)
    trajectory = point(problem)
    shooting, sub = ShootingFunctions(problem), SubproblemFunctions(problem)
    for functions in (shooting, sub):
        functions.xs[...], functions.us[...] = trajectory.xs, trajectory.us
    shooting.expand()
    sub.linearize()
    qp: OcpQp = sub.qp
    for k, action in enumerate(problem.actions):
        p = problem.parameters[k, : action.parameters.size]
        call = {"x": trajectory.xs[k], "u": trajectory.us[k, : action.nu], "x_next": trajectory.xs[k + 1], "p": p}
        m = {name: value.full() for name, value in action.quadratic_function(**call).items()}
        nu, ng = action.nu, m["lower"].shape[0]
        np.testing.assert_allclose(shooting.jacobian[k, :2].T, m["A"], atol=1e-15)
        np.testing.assert_allclose(shooting.gaps[k + 1], m["b"][:, 0], atol=1e-15)
        np.testing.assert_allclose(shooting.hessian[k, :2, :2], m["Q"], atol=1e-15)
        assert shooting.costs[k] == pytest.approx(m["cost"][0, 0], rel=1e-14)
        for name in ("A", "b", "Q", "q", "cost"):
            np.testing.assert_allclose(qp.dense(name)[k], m[name], atol=1e-15, err_msg=name)
        for name in ("C", "D", "lower", "upper"):
            np.testing.assert_allclose(qp.dense(name)[k, :ng, : m[name].shape[1]], m[name], atol=1e-15, err_msg=name)
        if nu:
            np.testing.assert_allclose(shooting.jacobian[k, 2:].T, m["B"], atol=1e-15)
            np.testing.assert_allclose(shooting.gradient[k, 2:], m["r"][:, 0], atol=1e-15)
        else:
            assert not shooting.jacobian[k, 2:].any() and shooting.hessian[k, 2, 2] == 1.0
            assert not qp.dense("B")[k].any() and not qp.dense("D")[k].any() and qp.dense("R")[k, 0, 0] == 1.0
            assert (qp.vector("lower")[k] < 0.0).all() and (qp.vector("upper")[k] > 0.0).all()
    last = problem.terminal.terminal_quadratic_function(trajectory.xs[6], problem.parameters[6, :3])
    np.testing.assert_allclose(shooting.last_hessian, last[0].full(), atol=1e-15)
    np.testing.assert_allclose(qp.dense_terminal("q"), last[1].full(), atol=1e-15)


@pytest.mark.parametrize("jit", ["1", "0"])
def test_roll_out_is_its_definition(problem: ShootingProblem, jit: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LGMPC_JIT", jit)
    rng = np.random.default_rng(1)
    trajectory, f = point(problem), ShootingFunctions(problem)
    assert f.compiled is (jit == "1")
    f.xs[...], f.us[...] = trajectory.xs, trajectory.us
    f.expand()
    f.feedback[...], f.feedforward[...] = rng.standard_normal((6, 1, 2)), rng.standard_normal((6, 1))
    f.u_upper[:3] = 0.4
    f.step_length[0] = alpha = 0.25
    f.roll_out()
    x = problem.x0
    for k, action in enumerate(problem.actions):
        u = trajectory.us[k] - alpha * f.feedforward[k] - f.feedback[k] @ (x - trajectory.xs[k])
        u = np.minimum(u, f.u_upper[k])[: action.nu]
        stage = action.evaluate(x, u, problem.parameters[k, : action.parameters.size])
        np.testing.assert_allclose(f.us_try[k, : action.nu], u, atol=1e-14)
        assert not f.us_try[k, action.nu :].any()
        assert f.costs_try[k] == pytest.approx(stage.cost, rel=1e-12)
        x = stage.x_next - (1 - alpha) * f.gaps[k + 1]
        np.testing.assert_allclose(f.xs_try[k + 1], x, atol=1e-13)
    f.measure_move()
    np.testing.assert_allclose(f.moved, f.xs - f.xs_try, atol=1e-14)


def test_copies_share_actions_and_no_data(problem: ShootingProblem) -> None:
    twin = problem.copy()
    assert twin.actions == problem.actions and twin.terminal is problem.terminal
    problem.set("weight", 9.0)
    problem.set_initial_state([1.0, 1.0])
    assert not (twin.parameters == problem.parameters).all() and not (twin.x0 == problem.x0).any()
