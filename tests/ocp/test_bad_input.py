"""What a user may get wrong in Python: one error that names the item, what came and what was expected."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from lgmpc import load_config, load_robot, run_config, solve_config
from lgmpc.actions import Action, FreeForwardDynamics, MultibodyAction, RungeKutta4
from lgmpc.costs import Bounded, ConstraintItem, Cost, CostItem, CostTerm, ParameterLayout, Residual
from lgmpc.costs.library import CoMPosition, Control, FrameTranslation
from lgmpc.errors import InputError
from lgmpc.ocp import ShootingProblem, Trajectory
from lgmpc.solvers import BoxFddp, Fddp, LineSearchSqp, Status
from lgmpc.state import StateVector

pytestmark = pytest.mark.usefixtures("interpreted")
MODEL = pin.buildSampleModelManipulator()
DYNAMICS = FreeForwardDynamics(MODEL)
LIMITS = ConstraintItem("motors", Control(6), -1.0, 1.0)
EFFORT = (CostItem("effort", Control(6)),)


def arm(costs: Any = EFFORT, constraints: Any = (), nodes: Any = 3) -> ShootingProblem:
    return ShootingProblem(MultibodyAction("arm", DYNAMICS, costs, constraints), nodes)


def own(expression: Callable[[Any], Any], nr: int = 1) -> ShootingProblem:
    """With a residual of the user's."""

    class Own(Residual):
        def expression(self, s: Any) -> Any:
            return expression(s)

    residual = Own()
    residual.nr = nr
    return arm([CostItem("mine", residual)])


def cart(called: str = "cart", **methods: Any) -> ShootingProblem:
    """With an action of the user's, some methods of which are replaced."""

    class Cart(Action):
        name, nu, state, parameters = called, 1, StateVector(2), ParameterLayout()

        def step(self, x: Any, u: Any, p: Any) -> Any:
            return methods.get("step", lambda x, u: x + 0.1 * ca.vertcat(x[1], u))(x, u)

        def cost(self, x: Any, u: Any, p: Any) -> Any:
            return methods.get("cost", lambda x, u: Cost((CostTerm(u),)))(x, u)

        def terminal_cost(self, x: Any, p: Any) -> Any:
            return Cost((CostTerm(x),))

        def constraint(self, x: Any, u: Any, p: Any) -> Any:
            return methods.get("constraint", lambda x, u: Bounded.stack())(x, u)

    return ShootingProblem(Cart(), 3)


def written(name: str, value: float) -> ShootingProblem:
    """Past the checks of ``set``."""
    problem = arm()
    problem.view(name)[1] = value
    return problem


CASES: dict[str, tuple[Callable[[], Any], str]] = {
    "duration of zero": (lambda: arm().set("duration", 0.0), "duration: got 0.0; expected numbers above zero"),
    "one duration": (
        lambda: arm().set("duration", [[0.1], [0.1], [-0.1], [0.1]]),
        "duration, node 2: got -0.1; expected numbers above zero",
    ),
    "duration written": (
        lambda: Fddp(written("duration", -0.1)).solve(),
        "duration, node 1: got -0.1; expected numbers above zero",
    ),
    "weight written": (
        lambda: LineSearchSqp(written("effort_weight", -2.0)).solve(),
        "effort_weight, node 1: got -2.0; expected no number below zero",
    ),
    "weight of a node": (
        lambda: arm().set("effort_weight", np.outer([1, 1, np.nan, 1], np.ones(6))),
        "effort_weight, node 2: got NaN or infinity; expected finite values",
    ),
    "parameter": (lambda: arm().set("efort_weight", 1.0), "parameter: got efort_weight; .* Did you mean effort_weight"),
    "text": (lambda: arm().set("duration", "long"), "duration: got 'long'; expected numbers"),  # type: ignore[arg-type]
    "ragged": (
        lambda: arm().set("effort_weight", [[1, 2], [1]]),  # type: ignore[list-item]
        r"effort_weight: got \[\[1, 2\], \[1\]\]; expected numbers, in rows of the same length",
    ),
    "node": (lambda: arm().set("duration", 1.0, nodes=[7]), "nodes: got 7; expected whole numbers from 0 to 3"),
    "node alone": (lambda: arm().set("duration", 1.0, nodes=1), r"nodes: got 1; expected a list: \[1\]"),  # type: ignore[arg-type]
    "half a node": (lambda: arm().set("duration", 1.0, nodes=[1.5]), "nodes: got 1.5; expected whole"),  # type: ignore[list-item]
    "half an interval": (lambda: arm(nodes=2.5), "nodes: got 2.5; expected at least one interval"),
    "first state": (lambda: arm().set_initial_state("home"), "x0: got 'home'; expected numbers"),  # type: ignore[arg-type]
    "guess": (
        lambda: Fddp(arm()).solve((np.zeros((4, 12)), np.zeros((3, 6)))),  # type: ignore[arg-type]
        r"guess: got tuple; expected a Trajectory\(xs, us\)",
    ),
    "scalar state": (lambda: arm().evaluate(0, 0.0, np.zeros(6)), r"x: got shape \(\); expected shape \(12,\)"),  # type: ignore[arg-type]
    "empty state": (lambda: arm().evaluate(0, np.zeros(0), np.zeros(6)), r"x: got shape \(0,\); expected shape"),
    "long state": (lambda: arm().evaluate(0, np.zeros(13), np.zeros(6)), r"x: got shape \(13,\); expected shape"),
    "long control": (
        lambda: arm().evaluate(0, np.zeros(12), np.zeros(7)),
        r"u: got shape \(7,\); expected shape \(6,\)",
    ),
    "scalar control": (lambda: arm().evaluate(0, np.zeros(12), 0.0), r"u: got shape \(\); expected shape \(6,\)"),  # type: ignore[arg-type]
    "last node": (lambda: arm().evaluate(3, np.zeros(12), np.zeros(6)), "node: got 3; expected an interval, 0 to 2"),
    "scalar parameters": (
        lambda: arm().action.evaluate(np.zeros(12), np.zeros(6), 0.0),  # type: ignore[arg-type]
        r"p: got shape \(\); expected shape",
    ),
    "terminal": (
        lambda: ShootingProblem(MultibodyAction("arm", DYNAMICS), 3, terminal="arm"),  # type: ignore[arg-type]
        "terminal: got str; expected an action",
    ),
    "bounds": (lambda: ConstraintItem("motors", Control(6), 1.0, -1.0), "lower of 'motors': got 1 in row 0, above"),
    "bound that is NaN": (lambda: ConstraintItem("motors", Control(6), np.nan), "lower of 'motors': got NaN"),
    "weight in words": (lambda: CostItem("u", Control(6), "heavy"), "weight of 'u': got 'heavy'; expected numbers"),
    "residual's name": (
        lambda: CostItem("u", "control"),  # type: ignore[arg-type]
        "residual of 'u': got str; expected a Residual",
    ),
    "residual's class": (
        lambda: CostItem("com", CoMPosition),  # type: ignore[arg-type]
        r"residual of 'com': got CoMPosition; expected a residual, as CoMPosition\(...\)",
    ),
    "activation's name": (
        lambda: CostItem("u", Control(6), 1.0, "huber"),  # type: ignore[arg-type]
        "activation of 'u': got str; expected an Activation",
    ),
    "negative rows": (lambda: own(lambda s: s.q, -1), "Own.nr of 'mine': got -1; expected its number of entries"),
    "robot's name": (
        lambda: load_robot("solo12"),  # type: ignore[arg-type]
        "spec: got str; expected a RobotSpec",
    ),
    "config's name": (
        lambda: run_config("solo12_balance"),  # type: ignore[arg-type]
        "config: got solo12_balance; expected a Config",
    ),
    "config of another kind": (
        lambda: solve_config(load_config("solo12_balance")),  # type: ignore[arg-type]
        r"config: got Config\(.*; expected a SolveConfig",
    ),
    "no item": (lambda: arm([Control(6)]), r"costs\[0\]: got Control; expected a CostItem"),
    "constraint as cost": (lambda: arm([LIMITS]), r"costs\[0\]: got ConstraintItem; expected a CostItem"),
    "cost as constraint": (
        lambda: arm((), [CostItem("u", Control(6))]),
        r"constraints\[0\]: got CostItem; expected a ConstraintItem",
    ),
    "item alone": (lambda: arm(CostItem("u", Control(6))), "costs: got CostItem; expected a list of CostItem"),
    "dynamics": (
        lambda: MultibodyAction("arm", MODEL),
        "dynamics: got Model; expected an object of a class of Dynamics",
    ),
    "integrator": (
        lambda: MultibodyAction("arm", DYNAMICS, integrator=RungeKutta4),  # type: ignore[arg-type]
        "integrator: got RungeKutta4; expected an object of a class of Integrator",
    ),
    "frame": (
        lambda: Fddp(arm([CostItem("hand", FrameTranslation("effector_bod"))])),
        "frame: got effector_bod; .* Did you mean effector_body",
    ),
    "size": (
        lambda: Fddp(arm([CostItem("u", Control(5))])),
        "Control.expression of 'u': got RuntimeError: .*x is 6x1, while y is 5x1; expected a CasADi column of shape",
    ),
    "expression's shape": (
        lambda: Fddp(own(lambda s: s.q, 2)),
        r"Own.expression of 'mine': got shape \(6, 1\); expected a CasADi column of shape \(2, 1\) for its nr",
    ),
    "expression of a number": (lambda: Fddp(own(lambda s: 1.0)), "Own.expression of 'mine': got float; expected"),
    "expression that fails": (
        lambda: Fddp(own(lambda s: s.q[0] / {}["mass"])),
        "Own.expression of 'mine': got KeyError: 'mass'; expected",
    ),
    "expression's parameter": (
        lambda: Fddp(own(lambda s: s["weigth"])),
        "parameter: got weigth; .* Did you mean weight",
    ),
    "action's name": (lambda: cart("my cart"), r"actions\[0\].name: got 'my cart'; expected letters, digits"),
    "step's shape": (lambda: Fddp(cart(step=lambda x, u: x[:1])), r"step of 'cart': got shape \(1, 1\); expected"),
    "no step": (lambda: Fddp(cart(step=lambda x, u: None)), "step of 'cart': got NoneType; expected a CasADi column"),
    "cost's type": (lambda: Fddp(cart(cost=lambda x, u: u**2)), r"cost of 'cart': got SX; expected Cost\("),
    "weight's shape": (
        lambda: Fddp(cart(cost=lambda x, u: Cost((CostTerm(x, weight=ca.SX([1, 2, 3])),)))),
        r"weight 0 of cost of 'cart': got shape \(3, 1\); expected a number or shape \(2, 1\), as its residual",
    ),
    "no constraint": (lambda: Fddp(cart(constraint=lambda x, u: None)), "constraint of 'cart': got NoneType"),
    "bounds' shapes": (
        lambda: LineSearchSqp(cart(constraint=lambda x, u: Bounded(u, ca.SX([0, 0]), ca.SX([1])))),
        r"lower of the constraint of 'cart': got shape \(2, 1\); expected shape \(1, 1\)",
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_one_error_names_item_and_expectation(case: str) -> None:
    act, message = CASES[case]
    with pytest.raises(InputError, match=message):
        act()


@pytest.mark.parametrize("make", [BoxFddp, LineSearchSqp])
def test_contradictory_bounds_are_explained_with_node_and_row(make: Any) -> None:
    problem = arm(constraints=[LIMITS])
    problem.set("motors_lower", 2.0, nodes=[1])
    solution = make(problem).solve()
    assert solution.status is Status.INFEASIBLE
    expected = "The bounds of 'motors' row 0 of node 1 contradict each other: lower 2 is above upper 1"
    assert expected in solution.explain()


def test_a_parameter_that_is_nan_is_explained_with_its_node() -> None:
    solution = Fddp(written("duration", np.nan)).solve()
    assert solution.status is Status.NOT_FINITE
    assert "Parameter 'duration' of node 1 ('arm') contains NaN" in solution.explain()


def test_gains_are_those_of_all_contacts_or_of_each() -> None:
    from lgmpc.actions import ContactForwardDynamics

    model = pin.buildSampleModelHumanoid()
    frames = [frame.name for frame in model.frames if frame.type == pin.FrameType.BODY][-2:]
    action = MultibodyAction("stand", ContactForwardDynamics(model, frames), [])
    problem = ShootingProblem(action, 2)
    problem.set("contact_gains", [3.0, 5.0])
    np.testing.assert_array_equal(problem.view("contact_gains"), np.tile([3.0, 5.0, 3.0, 5.0], (3, 1)))
    problem.set("contact_gains", [1.0, 2.0, 3.0, 4.0], nodes=[1])
    np.testing.assert_array_equal(problem.view("contact_gains")[1], [1.0, 2.0, 3.0, 4.0])
    problem.set("contact_gains", [[1.0, 2.0], [5.0, 6.0]], nodes=[0, 2])
    np.testing.assert_array_equal(problem.view("contact_gains")[2], [5.0, 6.0, 5.0, 6.0])
    with pytest.raises(InputError, match=r"contact_gains: got shape \(3,\); expected a number, shape \(2,\) or shape"):
        problem.set("contact_gains", [1.0, 2.0, 3.0])
    with pytest.raises(InputError, match="contact_gains: got -1.0; expected no number below zero"):
        problem.set("contact_gains", [1.0, -1.0])


def test_the_guess_of_another_problem_is_named() -> None:
    with pytest.raises(InputError, match=r"xs: got shape \(3, 12\); expected shape \(4, 12\)"):
        Fddp(arm()).solve(Trajectory(np.zeros((3, 12)), np.zeros((3, 6))))
