"""Wrong types, shapes and values of every public argument: one error of lgmpc's own, or a result."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.actions import *  # noqa: F403 - all of them are tried
from lgmpc.actions import Contact, ContactForwardDynamics, FreeForwardDynamics, MultibodyAction, PythonAction
from lgmpc.costs import *  # noqa: F403
from lgmpc.costs import ConstraintItem, CostItem, ParameterLayout
from lgmpc.costs.library import *  # noqa: F403
from lgmpc.costs.library import Control, StateError
from lgmpc.errors import LgmpcError
from lgmpc.ocp import *  # noqa: F403
from lgmpc.ocp import ShootingProblem, SubproblemFunctions, Trajectory
from lgmpc.solvers import *  # noqa: F403
from lgmpc.solvers import Fddp, RealTimeSqp
from lgmpc.solvers.qp import *  # noqa: F403
from lgmpc.state import StateVector

# ruff: noqa: F405

pytestmark = pytest.mark.usefixtures("interpreted")
MODEL, HUMANOID = pin.buildSampleModelManipulator(), pin.buildSampleModelHumanoid()
FRAMES = [frame.name for frame in HUMANOID.frames if frame.type == pin.FrameType.BODY][-2:]
DYNAMICS, STANDING = FreeForwardDynamics(MODEL), ContactForwardDynamics(HUMANOID, [Contact(FRAMES[0], 6), FRAMES[1]])
REACH = MultibodyAction("reach", DYNAMICS, [CostItem("u", Control(6)), CostItem("x", StateError(DYNAMICS.state))])
BOUNDED = MultibodyAction("bounded", DYNAMICS, [CostItem("u", Control(6))], [ConstraintItem("m", Control(6), -1, 1)])


def residual(kind: Any, dynamics: Any = DYNAMICS) -> Callable[..., Any]:
    """Return the construction of a residual, and of an action's expressions with it."""
    return lambda **given: MultibodyAction("a", dynamics, [CostItem("c", kind(**given))]).value_function


def reach() -> ShootingProblem:
    return ShootingProblem(REACH, 3)


def bounded() -> ShootingProblem:
    return ShootingProblem(BOUNDED, 3)


def still() -> Trajectory:
    return Trajectory(np.zeros((4, 12)), np.zeros((3, 6)))


def subproblem() -> Any:
    return SubproblemFunctions(bounded()).qp


def real_time() -> RealTimeSqp:
    solver = RealTimeSqp(bounded(), "piqp")
    solver.prepare()
    return solver


class Falling(PythonAction):
    name, nu, state, parameters = "falling", 1, StateVector(2), ParameterLayout()

    def step(self, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> np.ndarray:
        return x + 0.1 * np.array([x[1], u[0]])


def solution() -> Any:
    return Fddp(reach()).solve(max_iterations=1)


# name -> (callable, valid arguments)
CALLS: dict[str, tuple[Callable[..., Any], dict[str, Any]]] = {
    "Parameter": (
        lambda **k: ParameterLayout(Parameter(**k)),
        dict(name="a", size=2, meaning="m", default=0.0, sign="any", part=1),
    ),
    "ParameterLayout": (lambda a: ParameterLayout(a), dict(a=Parameter("a", 1, ""))),
    "layout.view": (
        lambda p, name: ParameterLayout(Parameter("a", 1, "")).view(p, name),
        dict(p=np.zeros(1), name="a"),
    ),
    "CostItem": (
        lambda **k: MultibodyAction("a", DYNAMICS, [CostItem(**k)]).value_function,
        dict(name="u", residual=Control(6), weight=1.0, activation=Huber()),
    ),
    "ConstraintItem": (
        lambda **k: MultibodyAction("a", DYNAMICS, [], [ConstraintItem(**k)]).value_function,
        dict(name="u", residual=Control(6), lower=-1.0, upper=1.0),
    ),
    "Huber": (lambda **k: CostItem("c", Control(6), 1.0, Huber(**k)), dict(threshold=1.0)),
    "QuadraticBarrier": (
        lambda **k: CostItem("c", Control(6), 1.0, QuadraticBarrier(**k)),
        dict(lower=-1.0, upper=1.0),
    ),
    "StateError": (residual(StateError), dict(state=DYNAMICS.state, reference=DYNAMICS.state.neutral())),
    "Control": (residual(Control), dict(nu=6, reference=0.0)),
    "JointPosition": (residual(JointPosition), dict(nu=6, reference=0.0)),
    "JointAcceleration": (residual(JointAcceleration), dict(nu=6, reference=0.0)),
    "ContactControlGravity, no contacts": (residual(ContactControlGravity), dict(nu=6)),
    "ContactControlGravity": (residual(ContactControlGravity, STANDING), dict(nu=STANDING.nu)),
    "CoMPosition": (residual(CoMPosition), dict(reference=0.0)),
    "CentroidalMomentum": (residual(CentroidalMomentum), dict(reference=0.0)),
    "FramePlacement": (residual(FramePlacement), dict(frame="effector_body", reference=[0, 0, 0, 0, 0, 0, 1.0])),
    "FrameRotation": (residual(FrameRotation), dict(frame="effector_body", reference=[0, 0, 0, 1.0])),
    "FrameTranslation": (residual(FrameTranslation), dict(frame="effector_body", reference=0.0)),
    "FrameVelocity": (residual(FrameVelocity), dict(frame="effector_body", axes=pin.LOCAL, reference=0.0)),
    "ContactForce": (residual(ContactForce, STANDING), dict(frame=FRAMES[1], size=3, reference=0.0)),
    "FrictionCone": (
        residual(FrictionCone, STANDING),
        dict(frame=FRAMES[1], facets=4, friction=0.7, normal=[0.0, 0.0, 1.0]),
    ),
    "CenterOfPressure": (residual(CenterOfPressure, STANDING), dict(frame=FRAMES[0], half_size=(0.1, 0.1))),
    "WrenchCone": (residual(WrenchCone, STANDING), dict(frame=FRAMES[0], half_size=(0.1, 0.1), friction=0.7)),
    "Contact": (
        lambda **k: ContactForwardDynamics(HUMANOID, [Contact(**k)]),
        dict(frame=FRAMES[0], size=2, axes=((1.0, 0, 0),), frame_axes=((0, 1.0, 0),)),
    ),
    "ContactForwardDynamics": (ContactForwardDynamics, dict(model=HUMANOID, contacts=FRAMES, loads=(), actuation=None)),
    "FreeForwardDynamics": (FreeForwardDynamics, dict(model=HUMANOID, actuation=None)),
    "ExternalWrench": (ExternalWrench, dict(model=HUMANOID)),
    "thrusters": (
        thrusters,
        dict(model=HUMANOID, positions=np.zeros((2, 3)), directions=np.tile([0, 0, 1.0], (2, 1)), drag_ratio=0.0),
    ),
    "MultibodyAction": (MultibodyAction, dict(name="b", dynamics=DYNAMICS, costs=(), constraints=(), integrator=None)),
    "ImpulseAction": (ImpulseAction, dict(name="b", model=HUMANOID, contacts=FRAMES, costs=(), constraints=())),
    "HoldAction": (HoldAction, dict(name="b", model=HUMANOID, costs=(), constraints=())),
    "CentroidalAction": (CentroidalAction, dict(contacts=4, facets=4)),
    "Variational": (Variational, dict(iterations=3)),
    "Stretched": (lambda a: Stretched(a), dict(a=REACH)),
    "PenalizedAction": (lambda a: PenalizedAction(a), dict(a=BOUNDED)),
    "FreePhase": (FreePhase, dict(start=0, lower=0.5, upper=2.0)),
    "FreeDurations": (FreeDurations, dict(problem=reach(), phases=[FreePhase(0, 0.5, 2.0)])),
    "ShootingProblem": (ShootingProblem, dict(action=REACH, nodes=3, terminal=REACH)),
    "problem.set": (lambda **k: reach().set(**k), dict(name="duration", value=0.1, nodes=[0])),
    "problem.view": (lambda **k: reach().view(**k), dict(name="duration")),
    "problem.set_initial_state": (lambda **k: reach().set_initial_state(**k), dict(x0=np.zeros(12))),
    "problem.evaluate": (lambda **k: reach().evaluate(**k), dict(node=0, x=np.zeros(12), u=np.zeros(6))),
    "problem.action_at": (lambda **k: reach().action_at(**k), dict(node=0)),
    "problem.rollout": (lambda **k: reach().rollout(**k), dict(us=np.zeros((3, 6)))),
    "problem.check": (lambda **k: reach().check(**k), dict(guess=still())),
    "Trajectory": (
        lambda **k: Fddp(reach()).solve(Trajectory(**k), max_iterations=1),
        dict(xs=np.zeros((4, 12)), us=np.zeros((3, 6))),
    ),
    "Action.evaluate": (REACH.evaluate, dict(x=np.zeros(12), u=np.zeros(6), p=REACH.parameters.default)),
    "PythonAction.evaluate": (Falling().evaluate, dict(x=np.zeros(2), u=np.zeros(1), p=np.zeros(0))),
    "check_derivatives": (
        check_derivatives,
        dict(
            subject=REACH,
            rng=np.random.default_rng(0),
            trajectory=None,
            parameters=None,
            points=1,
            spread=0.5,
            step=1e-5,
            tolerance=1e-6,
        ),
    ),
    "check_derivatives problem": (lambda **k: check_derivatives(reach(), **k), dict(trajectory=still())),
    "Fddp": (Fddp, dict(problem=reach(), settings=None)),
    "BoxFddp": (BoxFddp, dict(problem=bounded(), settings=None)),
    "AugmentedLagrangianFddp": (AugmentedLagrangianFddp, dict(problem=bounded(), settings=None)),
    "LineSearchSqp": (LineSearchSqp, dict(problem=bounded(), settings=None, qp_solver=None)),
    "NlpSolver": (NlpSolver, dict(problem=bounded(), settings=None)),
    "RealTimeSqp": (RealTimeSqp, dict(problem=bounded(), qp_solver="piqp")),
    "make_solver": (make_solver, dict(problem=bounded(), settings=LineSearchSqpSettings())),
    "check_method": (check_method, dict(problem=bounded(), settings=LineSearchSqpSettings())),
    "Fddp.solve": (
        lambda **k: Fddp(reach()).solve(**k),
        dict(guess=None, max_iterations=1, time_limit=1.0, callback=None, throw=False),
    ),
    "Sqp.solve": (
        lambda **k: LineSearchSqp(bounded()).solve(**k),
        dict(guess=None, max_iterations=1, time_limit=1.0, callback=None, throw=False),
    ),
    "Nlp.solve": (
        lambda **k: NlpSolver(bounded()).solve(**k),
        dict(guess=None, max_iterations=1, time_limit=1.0, callback=None, throw=False),
    ),
    "rt.set_guess": (lambda **k: real_time().set_guess(**k), dict(trajectory=still())),
    "rt.shift": (lambda **k: real_time().shift(**k), dict(fraction=0.5)),
    "Solution.control": (lambda **k: solution().control(**k), dict(node=0, x=np.zeros(12))),
    "History.column": (lambda **k: History().column(**k), dict(name="cost")),
    "History": (lambda a: Fddp(reach()).solve(callback=History(a), max_iterations=1), dict(a=History())),
    "make_qp_solver": (make_qp_solver, dict(solver="piqp", qp=subproblem())),
    "FddpSettings": (FddpSettings, dict(tolerance=1e-6, max_iterations=3, stationarity=1e-5)),
}
WRONG = {
    "None": None,
    "text": "text",
    "nan": float("nan"),
    "object": object(),
    "matrix": np.zeros((40, 40)),
    "ragged": [[1, 2], [1]],
}


@pytest.mark.parametrize("name", CALLS)
def test_misuse_is_named_or_harmless(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # "text" is a path too
    call, valid = CALLS[name]
    call(**valid)
    for argument in valid:
        for label, wrong in WRONG.items():
            if argument in ("throw", "compiled"):  # their truth counts
                continue
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                try:
                    call(**{**valid, argument: wrong})
                except LgmpcError:
                    continue
                except Exception as error:
                    pytest.fail(f"{name}({argument}={label}): {type(error).__name__}: {error}")
