"""What tests of several packages share: Solo12, actions, problems, derivatives by differences."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from lgmpc.actions import Action, CentroidalAction
from lgmpc.costs import Bounded, LeastSquares, Parameter, ParameterLayout, Residual, StageSymbols
from lgmpc.estimation.invariant_ekf import ErrorForm
from lgmpc.ocp import ShootingProblem
from lgmpc.robot import Robot, RobotSpec, load_robot
from lgmpc.state import StateVector

STANDING = np.array([0.0, 0.0, 0.24, 0, 0, 0, 0, 0, 0])
_FEET = np.array([[0.2, 0.15, 0.0], [0.2, -0.15, 0.0], [-0.2, 0.15, 0.0], [-0.2, -0.15, 0.0]])


@lru_cache
def solo() -> Robot:
    """Solo12 as loaded, without contact frames."""
    spec = RobotSpec(
        model="solo12",
        effort_limit_nm=1.8,
        velocity_limit_rad_s=30.0,
        position_limit_rad=(-3.0, 3.0),
        armature_kg_m2=3.6e-4,
    )
    return load_robot(spec)


@lru_cache
def solo8() -> Robot:
    """Solo8 on its feet: planar legs of two joints."""
    return load_robot(
        RobotSpec(
            model="solo8",
            contact_frames=("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT"),
            contact_radius_m=0.016,
            posture="standing",
            effort_limit_nm=1.8,
            velocity_limit_rad_s=30.0,
            position_limit_rad={"*_HFE": (-1.45, 1.45), "*_KFE": (-2.8, 2.8)},
            armature_kg_m2=3.6e-4,
        )
    )


@lru_cache
def b1_with_arm() -> Robot:
    """B1 on its feet with a Z1 arm on its back: seven joints that move no foot."""
    feet = ("FL_foot", "FR_foot", "RL_foot", "RR_foot")
    return load_robot(RobotSpec(model="b1_z1", contact_frames=feet, contact_radius_m=0.04))


class JointEffort(Residual):
    """Efforts of the actuated joints minus ``reference`` (nu,), N.m (N)."""

    def __init__(self, nu: int, reference: object = 0.0) -> None:
        self.nr = nu
        self.parameters = (Parameter("reference", nu, "reference of the efforts, N.m", reference),)

    def expression(self, s: StageSymbols) -> object:
        return s.tau - s["reference"]


class Unicycle(Action):
    """Crocoddyl's: position and heading, driven by speed and turning rate, interval 0.1 s."""

    nu = 2

    def __init__(self, name: str = "unicycle") -> None:
        self.name = name
        self.state = StateVector(3)
        self.parameters = ParameterLayout(Parameter("weights", 2, "of state and control, squared in the cost"))

    def step(self, x, u, p):
        return x + 0.1 * ca.vertcat(ca.cos(x[2]) * u[0], ca.sin(x[2]) * u[0], u[1])

    def cost(self, x, u, p):
        return LeastSquares(ca.vertcat(x, u), ca.vertcat(*[p[0] ** 2] * 3, *[p[1] ** 2] * 2))

    def terminal_cost(self, x, p):
        return LeastSquares(x, ca.vertcat(*[p[0] ** 2] * 3))

    def constraint(self, x, u, p):
        return Bounded.stack()


class Constrained(Action):
    """The base of actions with dynamics and cost of another one, and a constraint of their own."""

    def __init__(self, base: Action) -> None:
        self.state, self.nu, self.parameters, self.base = base.state, base.nu, base.parameters, base

    def step(self, x, u, p):
        return self.base.step(x, u, p)

    def cost(self, x, u, p):
        return self.base.cost(x, u, p)

    def terminal_cost(self, x, p):
        return self.base.terminal_cost(x, p)


def standing_quadruped(nodes: int, facets: int) -> ShootingProblem:
    """The problem of a standing quadruped, whose weight is balanced by the reference forces."""
    problem = ShootingProblem(CentroidalAction(4, facets), nodes)
    for name, value in {
        "mass": 2.5,
        "gravity": [0.0, 0.0, -9.81],
        "duration": 0.02,
        "contact_points": _FEET.ravel(),
        "contact_flags": 1.0,
        "friction": 0.6,
        "normal_force_min": 0.5,
        "normal_force_max": 25.0,
        "x_reference": STANDING,
        "u_reference": np.tile([0.0, 0.0, 2.5 * 9.81 / 4], 4),
        "x_weight": [1e3] * 3 + [10.0] * 3 + [1e3] * 3,
        "u_weight": 1e-3,
    }.items():
        problem.set(name, value)
    problem.set_initial_state(STANDING)
    return problem


def upward(rng: np.random.Generator, count: int) -> np.ndarray:
    """Return (count, 3) unit vectors within some 30 degrees of the vertical."""
    vectors = np.array([0.0, 0.0, 1.0]) + rng.uniform(-0.4, 0.4, (count, 3))
    return vectors / np.linalg.norm(vectors, axis=1)[:, None]


def centroidal_parameters(
    action: CentroidalAction, rng: np.random.Generator, feet: np.ndarray, **given: object
) -> np.ndarray:
    """Parameters of a centroidal action on given feet (nc, 3), weights and references at random."""
    values: dict[str, object] = {
        "mass": 2.5,
        "gravity": [0.1, -0.2, -9.81],
        "duration": 0.05,
        "contact_points": feet.ravel(),
        "contact_normals": upward(rng, len(feet)).ravel(),
        "contact_flags": 1.0,
        "friction": 0.6,
        "normal_force_min": 0.5,
        "normal_force_max": 25.0,
        "external_wrench": rng.standard_normal(6),
        "x_reference": 0.1 * rng.standard_normal(9),
        "u_reference": rng.standard_normal(action.nu),
        "x_weight": rng.uniform(0.1, 10.0, 9),
        "u_weight": rng.uniform(0.1, 1.0, action.nu),
        **given,
    }
    p = np.zeros(action.parameters.size)
    for name, value in values.items():
        p[action.parameters[name]] = value
    return p


@lru_cache
def _retraction(form: ErrorForm, columns: int) -> ca.Function:
    pose, error = ca.SX.sym("pose", columns, columns), ca.SX.sym("error", 9 + 3 * (columns - 5))
    return ca.Function("retraction", [pose, error], [form.retract(pose, error)])


@lru_cache
def _error(form: ErrorForm, columns: int) -> ca.Function:
    poses = ca.SX.sym("estimate", columns, columns), ca.SX.sym("truth", columns, columns)
    return ca.Function("error", poses, [form.error(*poses)])


def retracted(form: ErrorForm, pose: np.ndarray, error: np.ndarray) -> np.ndarray:
    """The truth, if ``error`` is the estimate's."""
    return np.array(_retraction(form, len(pose))(pose, error))


def error_between(form: ErrorForm, estimate: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """The error of an estimate, without that of the biases."""
    return np.array(_error(form, len(estimate))(estimate, truth)).ravel()


def jacobian(function, size: int, h: float = 1e-5) -> np.ndarray:
    """Derivative of a function of (size,) at zero, by central differences."""
    steps = h * np.eye(size)
    return np.stack([(function(s) - function(-s)) / (2.0 * h) for s in steps], axis=1)
