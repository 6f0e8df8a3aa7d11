"""The expansion as a pipeline against the one written out."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from lgmpc.actions import (
    Action,
    Contact,
    ContactForwardDynamics,
    ExternalWrench,
    FreeForwardDynamics,
    HoldAction,
    ImpulseAction,
    MultibodyAction,
    RungeKutta4,
)
from lgmpc.compile import BatchKernel, Pipeline, find_compiler, reporting
from lgmpc.costs import ConstraintItem, CostItem, Huber, QuadraticBarrier
from lgmpc.costs.library import ContactForce, Control, FrameTranslation, FrictionCone, JointAcceleration, StateError
from lgmpc.robot import RobotSpec, load_robot

FEET = ("FL_FOOT", "HR_FOOT")


@lru_cache
def solo() -> pin.Model:
    limits = {"effort_limit_nm": 1.8, "velocity_limit_rad_s": 30.0, "position_limit_rad": (-3.0, 3.0)}
    return load_robot(RobotSpec(model="solo12", contact_frames=FEET, **limits)).model


def costs(state: object, nu: int, frame: str, forces: bool) -> list[CostItem]:
    items = [
        CostItem("posture", StateError(state), 0.3),
        CostItem("effort", Control(nu), 1e-2),
        CostItem("place", FrameTranslation(frame, [0.1, 0.2, 0.3]), 2.0, Huber(0.5)),
    ]
    if forces:
        items += [
            CostItem("cone", FrictionCone(frame, 8, 0.4), 3.0, QuadraticBarrier(0.0, np.inf)),
            CostItem("rate", JointAcceleration(int(state.model.nv)), 1e-3),
        ]
    return items


def make(kind: str) -> Action:
    model, ends = solo(), list(FEET)
    if kind == "arm":
        arm = pin.buildSampleModelManipulator()
        dynamics = FreeForwardDynamics(arm)
        return MultibodyAction("arm", dynamics, costs(dynamics.state, dynamics.nu, arm.frames[-1].name, False))
    if kind == "impulse":
        impulse = [CostItem("force", ContactForce(ends[0]), 0.1)]
        return ImpulseAction("impulse", model, ends, impulse)
    contacts = [Contact(ends[0], 6), Contact(ends[1], 3)] if kind == "surface" else ends
    loads = [ExternalWrench(model)] if kind == "surface" else []
    dynamics = ContactForwardDynamics(model, contacts, loads)
    rows = [ConstraintItem("motors", Control(dynamics.nu), -1.0, 1.0)]
    if kind == "points":
        rows.append(ConstraintItem("grip", FrictionCone(ends[1], 4, 0.5), 0.0, np.inf))
    items = costs(dynamics.state, dynamics.nu, ends[0], kind == "points")
    return MultibodyAction(kind, dynamics, items, rows)


@pytest.mark.parametrize(
    ("kind", "jit"),
    [
        *((kind, "0") for kind in ("points", "surface", "impulse")),
        ("arm", "1"),
        *(pytest.param(kind, "1", marks=pytest.mark.slow) for kind in ("points", "surface", "impulse")),
    ],
)
def test_the_pipeline_is_the_expansion(kind: str, jit: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Interpreted and compiled."""
    monkeypatch.setenv("LGMPC_JIT", jit)
    action = make(kind)
    assert action.expansion is not None
    steps = action.expansion.steps
    state, n = action.state, action.state.ndx + action.nu
    rng = np.random.default_rng(0)
    stages = 3
    xs = np.array([state.integrate(state.neutral(), rng.uniform(-0.8, 0.8, state.ndx)) for _ in range(stages + 1)])
    us, p = rng.normal(size=(stages, action.nu)), np.tile(action.parameters.default, (stages, 1))
    if kind not in ("arm", "impulse"):
        action.parameters.view(p, "contact_points")[...] = rng.normal(size=(stages, 6))
        action.parameters.view(p, "contact_gains")[...] = rng.uniform(size=(stages, 4))
    if kind == "surface":
        action.parameters.view(p, "external_wrench")[...] = rng.normal(size=(stages, 6))
    if kind != "arm":
        action.parameters.view(p, "contact_flags")[1] = [1.0, 0.0]
        action.parameters.view(p, "contact_damping")[2] = 0.01
    outputs = ("jacobian", "gap", "hessian", "gradient", "cost", "rows", "lower", "upper")
    inputs = {"x": state.nx, "u": action.nu, "x_next": state.nx, "p": action.parameters.size}
    pipeline = Pipeline(f"{kind}_whole", inputs, steps, {name: name for name in outputs})
    memory = {name: np.zeros((stages, pipeline.sizes[name])) for name in outputs}
    assert BatchKernel(pipeline).bind(stages, x=xs[:-1].copy(), u=us, x_next=xs[1:].copy(), p=p, **memory)() == 0
    for k in range(stages):
        given = action.quadratic_function(xs[k], us[k], xs[k + 1], p[k])
        m = {name: value.full() for name, value in zip(action.quadratic_function.name_out(), given, strict=True)}
        rows = m["lower"].size
        expected = {
            "jacobian": np.hstack([m["A"], m["B"]]),
            "gap": m["b"],
            "hessian": np.block([[m["Q"], m["S"].T], [m["S"], m["R"]]]),
            "gradient": np.vstack([m["q"], m["r"]]),
            "cost": m["cost"],
            "rows": np.hstack([m["C"].reshape(rows, state.ndx), m["D"].reshape(rows, action.nu)]),
            "lower": m["lower"],
            "upper": m["upper"],
        }
        for name, value in expected.items():
            height, width = value.shape
            got = memory[name][k].reshape(width, height).T
            scale = 1.0 + np.abs(value[np.isfinite(value)]).max(initial=0.0)
            np.testing.assert_allclose(got, value, rtol=0, atol=1e-11 * scale, err_msg=f"{name} of stage {k}")
            outside = ca.DM(action.expansion.columns[name], 1.0).full() == 0.0
            assert not got[outside].any(), f"{name} of stage {k} has entries outside of its pattern"
    assert n * n == pipeline.sizes["hessian"]


def test_costs_do_not_compile_the_dynamics_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if find_compiler() is None:
        pytest.skip("no C compiler is installed")
    monkeypatch.setenv("LGMPC_CACHE_DIR", str(tmp_path / "cache"))
    arm = pin.buildSampleModelManipulator()
    dynamics = FreeForwardDynamics(arm)
    first = MultibodyAction("first", dynamics, [CostItem("effort", Control(dynamics.nu))])
    more = [CostItem("effort", Control(dynamics.nu)), CostItem("posture", StateError(dynamics.state))]
    second = MultibodyAction("second", FreeForwardDynamics(arm), more)
    messages: list[str] = []
    for action in (first, second):
        messages.clear()
        assert action.expansion is not None
        steps = action.expansion.steps
        inputs = {"x": action.state.nx, "u": action.nu, "x_next": action.state.nx, "p": action.parameters.size}
        outputs = {name: name for name in ("jacobian", "gap", "hessian", "gradient", "cost")}
        with reporting(messages.append):
            BatchKernel(Pipeline(action.name, inputs, steps, outputs))
    started = [message for message in messages if "once, later runs load it" in message]
    assert len(started) == 1 and "'second_costs'" in started[0]


def test_other_actions_are_expanded_as_they_are_written() -> None:
    model = pin.buildSampleModelManipulator()
    dynamics = FreeForwardDynamics(model)
    assert MultibodyAction("runge_kutta", dynamics, integrator=RungeKutta4()).expansion is None
    assert HoldAction("hold", model).expansion is None
