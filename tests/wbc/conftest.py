"""Robots, and states and targets to try the whole-body QP on."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin
import piqp
import pytest
from scipy.optimize import lsq_linear

from lgmpc.costs import StageSymbols
from lgmpc.robot import Robot, RobotSpec, load_robot
from lgmpc.robot.feet import UP
from lgmpc.wbc import SymbolicTask, WholeBodyController, WholeBodySettings

RandomState = Callable[..., tuple[np.ndarray, np.ndarray]]

SPECS = {
    "solo12": RobotSpec(
        model="solo12",
        contact_frames=("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT"),
        contact_radius_m=0.016,
        posture={"*_HAA": 0.0, "F?_HFE": 0.8, "F?_KFE": -1.6, "H?_HFE": -0.8, "H?_KFE": 1.6},
        effort_limit_nm=1.8,
        velocity_limit_rad_s=30.0,
        position_limit_rad={"*_HAA": (-0.9, 0.9), "*_HFE": (-1.45, 1.45), "*_KFE": (-2.8, 2.8)},
        armature_kg_m2=3.6e-4,
    ),
    "anymal_c": RobotSpec(
        model="anymal_c",
        contact_frames=("LF_FOOT", "RF_FOOT", "LH_FOOT", "RH_FOOT"),
        contact_radius_m=0.03,
        armature_kg_m2=0.1,
    ),
    "stilts": RobotSpec(
        urdf=Path(__file__).parent / "data" / "stilts.urdf",
        contact_frames=("foot_a", "foot_b", "foot_c"),
        contact_radius_m=0.05,
        posture={"knee_?": 0.2},
        armature_kg_m2=0.01,
    ),
}


@lru_cache
def robot_named(name: str) -> Robot:
    return load_robot(SPECS[name])


@pytest.fixture(scope="session")
def solo12() -> Robot:
    return robot_named("solo12")


@pytest.fixture
def solo12_spec() -> RobotSpec:
    return SPECS["solo12"]


@pytest.fixture(scope="session", params=["solo12", pytest.param("anymal_c", marks=pytest.mark.slow), "stilts"])
def robot(request: pytest.FixtureRequest) -> Robot:
    """A light quadruped, a heavy one, and one on three legs that slide."""
    return robot_named(request.param)


@pytest.fixture(scope="session")
def random_state() -> RandomState:
    """A tilted, moving state around the reference posture, somewhere in the world."""

    def draw(rng: np.random.Generator, robot: Robot) -> tuple[np.ndarray, np.ndarray]:
        step = np.concatenate([rng.normal(0, 1, 3), rng.normal(0, 0.2, 3), rng.normal(0, 0.15, robot.nu)])
        return pin.integrate(robot.model, robot.q_reference, step), rng.normal(0, 0.5, robot.nv)

    return draw


@pytest.fixture
def controller(solo12: Robot) -> WholeBodyController:
    return WholeBodyController(solo12, WholeBodySettings())


@pytest.fixture(scope="session")
def randomise() -> Callable[[WholeBodyController, np.random.Generator], None]:
    """Set targets that the robot could nearly reach from its sensed state."""

    def write(wbc: WholeBodyController, rng: np.random.Generator) -> None:
        terms = wbc.terms
        targets = {name: task.target for name, task in wbc.tasks.items()}
        targets["com"].position[:] = terms.com + rng.normal(0, 0.02, 3)
        targets["com"].velocity[:] = rng.normal(0, 0.2, 3)
        targets["com"].acceleration[:] = rng.normal(0, 2.0, 3)
        targets["base_orientation"].rotation[:] = terms.rotation @ pin.exp3(rng.normal(0, 0.2, 3))
        targets["base_orientation"].angular_velocity[:] = rng.normal(0, 0.3, 3)
        targets["posture"].position[:] = terms.q[7:] + rng.normal(0, 0.2, terms.q.size - 7)
        targets["swing"].position[:] = terms.contact_points + rng.normal(0, 0.02, terms.contact_points.shape)
        share = wbc.robot.mass * 9.81 / wbc.robot.nc
        wbc.external_wrench[:] = share * np.concatenate([rng.normal(0, 0.3, 3), rng.normal(0, 0.03, 3)])
        wbc.contacts.target_forces[:] = share * rng.normal((0, 0, 1.0), 0.15, wbc.contacts.target_forces.shape)
        wbc.joint_load[:] = rng.normal(0, 0.05 * wbc.robot.effort_limit)

    return write


class Rows:
    """The rows of a task as numbers, interpreted: ``jacobian``, ``rhs`` and ``weight`` at a state."""

    def __init__(self, robot: Robot, task: SymbolicTask) -> None:
        q, v, stance = ca.SX.sym("q", robot.nq), ca.SX.sym("v", robot.nv), ca.SX.sym("stance", robot.nc)
        memory, normals = ca.SX.sym("memory", task.layout.size), ca.DM(np.tile(UP, robot.nc))
        parameters = {f"{task.name}_{key}": part for key, part in task.layout.split(memory).items()}
        rows = task.rows(
            StageSymbols(robot.symbolic, ca.vertcat(q, v), {"stance": stance, "normals": normals, **parameters})
        )
        outputs = [ca.densify(part) for part in (rows.jacobian, rows.rhs, rows.weight)]
        self._function = ca.Function("rows", [q, v, stance, memory], outputs)
        self._task, self._nc = task, robot.nc

    def __call__(self, q: np.ndarray, v: np.ndarray, stance: Any = True) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        flags = np.broadcast_to(np.asarray(stance, dtype=float), self._nc)
        jacobian, rhs, weight = self._function(q, v, flags, self._task.memory)
        return jacobian.full(), rhs.full().ravel(), weight.full().ravel()


@pytest.fixture(scope="session")
def rows_of() -> Callable[[Robot, SymbolicTask], Rows]:
    return Rows


class Qp:
    """What a QP's point is measured by, from the data in the memory of ``qp``: attributes as of a WholeBodySolver."""

    @staticmethod
    def cost(qp: Any, z: np.ndarray) -> float:
        return float(0.5 * z @ qp.hessian @ z + qp.gradient @ z)

    @staticmethod
    def violation(qp: Any, z: np.ndarray) -> float:
        rows = qp.inequality @ z
        outside = [rows - qp.upper, qp.lower - rows, z - qp.box_upper, qp.box_lower - z]
        return float(np.concatenate([np.abs(qp.equality @ z - qp.equality_rhs), *outside]).max())

    @staticmethod
    def stationarity(qp: Any, z: np.ndarray, near: float = 1e-5) -> float:
        """What multipliers of the right sign, of the constraints that hold at z, leave of the gradient."""
        rows, identity = qp.inequality @ z, np.eye(z.size)
        normals = np.vstack(
            [
                qp.inequality[rows > qp.upper - near],
                -qp.inequality[rows < qp.lower + near],
                identity[z > qp.box_upper - near],
                -identity[z < qp.box_lower + near],
            ]
        )
        lowest = np.concatenate([np.full(qp.equality.shape[0], -np.inf), np.zeros(len(normals))])
        columns, slope = np.vstack([qp.equality, normals]).T, qp.hessian @ z + qp.gradient
        found = lsq_linear(columns, -slope, (lowest, np.inf), method="bvls", tol=1e-14)
        return float(np.abs(found.fun).max())

    @staticmethod
    def solve_by_interior_point(qp: Any) -> np.ndarray:
        solver = piqp.DenseSolver()
        solver.settings.eps_abs = 1e-8
        solver.settings.eps_rel = 1e-12  # gradients reach 1e5: stationarity cannot fall below their rounding
        bounds = [np.where(np.abs(b) > 1e19, np.copysign(np.inf, b), b) for b in (qp.box_lower, qp.box_upper)]
        lower = np.where(qp.lower < -1e19, -np.inf, qp.lower)
        solver.setup(
            qp.hessian, qp.gradient, qp.equality, qp.equality_rhs, qp.inequality, lower, qp.upper, bounds[0], bounds[1]
        )
        assert solver.solve() == piqp.PIQP_SOLVED
        return np.array(solver.result.x)


@pytest.fixture(scope="session")
def measures() -> type[Qp]:
    return Qp
