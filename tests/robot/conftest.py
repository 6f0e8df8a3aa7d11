from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from lgmpc.robot import RobotSpec, load_robot
from lgmpc.robot.symbolic import SymbolicModel

DATA = Path(__file__).parent / "data"
SOLO_FEET = ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT")
SOLO = {"effort_limit_nm": 1.8, "velocity_limit_rad_s": 30.0, "armature_kg_m2": 3.6e-4}
SPECS = {
    "solo12": RobotSpec(model="solo12", **SOLO),
    "anymal_c": RobotSpec(model="anymal_c", armature_kg_m2=0.1),
    "talos": RobotSpec(model="talos"),
    "panda": RobotSpec(model="panda", armature_kg_m2={"panda_joint?": 0.2}),
    "iris": RobotSpec(model="iris"),
    "joints": RobotSpec(urdf=DATA / "joints.urdf", armature_kg_m2=0.01),
}
FRAMES = {
    "solo12": "HR_FOOT",
    "anymal_c": "RH_FOOT",
    "talos": "gripper_left_fingertip_1_link",
    "panda": "panda_hand_tcp",
    "iris": "iris__rotor_2",
    "joints": "tool",
    "everything": "antenna",
}


def everything() -> pin.Model:
    """The URDF of all joints, plus what no URDF has: spherical, an inner free-flyer, and a second root."""
    model = pin.buildModelFromUrdf(str(DATA / "joints.urdf"), pin.JointModelFreeFlyer())
    pin.seed(7)
    # After the last joint: Pinocchio's crba assumes depth-first order.
    ball = model.addJoint(model.njoints - 1, pin.JointModelSpherical(), pin.SE3.Random(), "ball")
    model.appendBodyToJoint(ball, pin.Inertia.Random(), pin.SE3.Random())
    satellite = model.addJoint(ball, pin.JointModelFreeFlyer(), pin.SE3.Random(), "satellite")
    model.appendBodyToJoint(satellite, pin.Inertia.Random(), pin.SE3.Random())
    model.addFrame(pin.Frame("antenna", satellite, pin.SE3.Random(), pin.OP_FRAME))
    crane = model.addJoint(0, pin.JointModelSpherical(), pin.SE3.Random(), "crane")
    model.appendBodyToJoint(crane, pin.Inertia.Random(), pin.SE3.Random())
    hook = model.addJoint(crane, pin.JointModelPZ(), pin.SE3.Random(), "hook")
    model.appendBodyToJoint(hook, pin.Inertia.Random(), pin.SE3.Random())
    model.armature = np.linspace(0.01, 0.2, model.nv)
    return model


@dataclass(frozen=True)
class State:
    """A random state of a model, and random inputs."""

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    tau: np.ndarray
    wrench: np.ndarray


def assert_close(got: np.ndarray, expected: np.ndarray, relative: float = 1e-10) -> None:
    """Compare with the largest entry of ``expected`` as the scale."""
    expected = np.asarray(expected)
    assert got.shape == expected.shape
    assert np.abs(got - expected).max() <= relative * np.abs(expected).max()


class Case:
    """A model with its symbolic quantities as functions, built once."""

    def __init__(self, name: str) -> None:
        self.model = everything() if name == "everything" else load_robot(SPECS[name]).model
        self.data = self.model.createData()
        self.frame = self.model.getFrameId(FRAMES[name])
        self.functions = symbolic_functions(self.model, FRAMES[name])

    def states(self, count: int = 8) -> list[State]:
        """States with any base rotation, any joint angle and high speeds."""
        rng = np.random.default_rng(3)
        states = []
        for _ in range(count):
            tangent = rng.normal(size=self.model.nv, scale=2.0)
            q = pin.normalize(self.model, pin.integrate(self.model, pin.neutral(self.model), tangent))
            v, a, tau = (rng.normal(size=self.model.nv, scale=scale) for scale in (3.0, 10.0, 5.0))
            states.append(State(q, v, a, tau, rng.normal(size=6, scale=20.0)))
        return states

    def value(self, quantity: str, state: State) -> np.ndarray:
        """Evaluate a quantity; columns come as (n,)."""
        inputs = (state.q, state.v, state.a, state.tau, state.wrench)
        result = self.functions[quantity](*inputs).full()
        return result.ravel() if self.functions[quantity].size2_out(0) == 1 and quantity != "crba" else result

    def check(self, quantity: str, state: State, expected: np.ndarray, relative: float = 1e-10) -> None:
        assert_close(self.value(quantity, state), expected, relative)


def symbolic_functions(model: pin.Model, frame: str) -> dict[str, ca.Function]:
    """One function of (q, v, a, tau, wrench) for each quantity, all from one symbolic model."""
    symbolic = SymbolicModel(model)
    sizes = {"q": model.nq, "v": model.nv, "a": model.nv, "tau": model.nv, "wrench": 6}
    inputs = [ca.SX.sym(key, size) for key, size in sizes.items()]
    q, v, a, tau, wrench = inputs
    placement = symbolic.frame_placement(q, frame)
    outputs = {
        "rotation": placement.rotation,
        "translation": placement.translation,
        "last_joint": symbolic.joint_placement(q, model.njoints - 1).translation,
        "com": symbolic.com(q),
        "vcom": symbolic.vcom(q, v),
        "jacobian_com": symbolic.jacobian_com(q),
        "momentum_matrix": symbolic.momentum_matrix(q),
        "momentum": symbolic.momentum(q, v),
        "momentum_rate": symbolic.momentum_rate(q, v, a),
        "rnea": symbolic.rnea(q, v, a),
        "rnea_external": symbolic.rnea(q, v, a, {frame: wrench}),
        "nle": symbolic.nle(q, v),
        "gravity": symbolic.gravity(q),
        "crba": symbolic.crba(q),
        "solved": symbolic.mass_factor(q).solve(ca.horzcat(tau, a)),
    }
    for reference in (pin.LOCAL, pin.LOCAL_WORLD_ALIGNED, pin.WORLD):
        outputs[f"jacobian {reference}"] = symbolic.frame_jacobian(q, frame, reference)
        outputs[f"velocity {reference}"] = symbolic.frame_velocity(q, v, frame, reference)
    for reference in (pin.LOCAL, pin.LOCAL_WORLD_ALIGNED):
        outputs[f"acceleration {reference}"] = symbolic.frame_acceleration(q, v, a, frame, reference)
        outputs[f"drift {reference}"] = symbolic.frame_drift(q, v, frame, reference)
    return {key: ca.Function(key.replace(" ", "_"), inputs, [value]) for key, value in outputs.items()}


@lru_cache
def case_of(name: str) -> Case:
    return Case(name)


@pytest.fixture(params=[*SPECS, "everything"])
def case(request: pytest.FixtureRequest) -> Case:
    """Each robot of the acceptance grid, and two models with every kind of joint."""
    return case_of(request.param)


@pytest.fixture
def case_named() -> Callable[[str], Case]:
    return case_of


@pytest.fixture
def close() -> Callable[..., None]:
    return assert_close


@pytest.fixture
def data_dir() -> Path:
    return DATA


@pytest.fixture
def solo_spec() -> RobotSpec:
    """Solo12 as built."""
    return RobotSpec(model="solo12", contact_frames=SOLO_FEET, contact_radius_m=0.016, **SOLO)
