"""The same optimal control problems for lgmpc and for Crocoddyl: one set of numbers, two ways to write them down.

``ours()`` and ``theirs()`` can be read side by side by a user of either library. ``bench_optimiser.py`` times
both; ``tests/crocoddyl`` compares their solutions. Crocoddyl comes with the extra ``bench`` of lgmpc.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from lgmpc.actions import ContactForwardDynamics, MultibodyAction
from lgmpc.costs import ConstraintItem, CostItem, QuadraticBarrier
from lgmpc.costs.library import CoMPosition, Control, FrameTranslation, FrictionCone, StateError
from lgmpc.ocp import ShootingProblem, Trajectory
from lgmpc.robot import Robot, RobotSpec, load_robot

FEET = ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT")
GAINS = np.array([20.0, 6.0])  # draw the feet back to their places: 1/s2 and 1/s


def solo12() -> Robot:
    """Solo12 with its knees bent."""
    spec = RobotSpec(
        model="solo12",
        contact_frames=FEET,
        effort_limit_nm=1.8,
        velocity_limit_rad_s=30.0,
        position_limit_rad=(-3.2, 3.2),
        posture={"*_HAA": 0.0, "F?_HFE": 0.8, "H?_HFE": -0.8, "F?_KFE": -1.6, "H?_KFE": 1.6},
    )
    return load_robot(spec)


def anymal() -> Robot:
    """ANYmal C with its knees bent."""
    spec = RobotSpec(
        model="anymal_c",
        contact_frames=("LF_FOOT", "RF_FOOT", "LH_FOOT", "RH_FOOT"),
        effort_limit_nm=80.0,
        velocity_limit_rad_s=7.5,
        position_limit_rad=(-9.4, 9.4),
    )
    return load_robot(spec)


def weighted(costs: Any, name: str, residual: Any, weights: np.ndarray) -> None:
    """Add a weighted square to a sum of Crocoddyl's."""
    import crocoddyl

    activation = crocoddyl.ActivationModelWeightedQuad(weights)
    costs.addCost(name, crocoddyl.CostModelResidual(costs.state, activation, residual), 1.0)


@dataclass(frozen=True)
class Stance:
    """Solo12 on four feet, pushed, moves its centre of mass.

    Attributes:
        nodes: N.
        dt: length of an interval, s.
        robot: Solo12.
        com_weight: of the centre of mass.
        effort_weight: of the torques.
    """

    nodes: int = 20
    dt: float = 0.02
    robot: Robot = field(default_factory=solo12, repr=False)
    com_weight: float = 100.0
    effort_weight: float = 0.1

    @property
    def names(self) -> tuple[str, ...]:
        """Frames of the feet."""
        return self.robot.contact_frames

    @cached_property
    def feet(self) -> np.ndarray:
        """(4, 3) where the feet are, m."""
        model, data = self.robot.model, self.robot.model.createData()
        pin.framesForwardKinematics(model, data, self.robot.q_reference)
        return np.array([data.oMf[i].translation for i in self.robot.contact_ids])

    @cached_property
    def com(self) -> np.ndarray:
        """(3,) where the centre of mass shall be, m."""
        model = self.robot.model
        com = pin.centerOfMass(model, model.createData(), self.robot.q_reference)
        return np.asarray(com + [0.02, 0.01, -0.02])

    @property
    def x_reference(self) -> np.ndarray:
        """(nx,) at rest in the reference posture."""
        return np.concatenate([self.robot.q_reference, np.zeros(self.robot.nv)])

    @property
    def x0(self) -> np.ndarray:
        """(nx,) the same, pushed."""
        x0 = self.x_reference
        x0[self.robot.nq : self.robot.nq + 6] = [0.1, 0.2, 0.0, 0.3, -0.2, 0.1]
        return x0

    @property
    def state_weights(self) -> np.ndarray:
        """(ndx,) of the state's distance from the reference."""
        nu = self.robot.nv - 6
        parts = [np.zeros(3), np.full(3, 5.0), np.full(nu, 0.5), np.full(6, 0.5), np.full(nu, 0.05)]
        return np.concatenate(parts)

    def guess(self) -> Trajectory:
        """The first state at all nodes, with the efforts that hold the robot's weight as well as they can."""
        model, nv = self.robot.model, self.robot.nv
        data = model.createData()
        q = self.robot.q_reference
        load = pin.rnea(model, data, q, np.zeros(nv), np.zeros(nv))
        pin.computeJointJacobians(model, data, q)
        pin.framesForwardKinematics(model, data, q)
        jacobian = np.vstack(
            [pin.getFrameJacobian(model, data, i, pin.LOCAL_WORLD_ALIGNED)[:3] for i in self.robot.contact_ids]
        )
        forces = np.linalg.lstsq(jacobian[:, :6].T, load[:6])[0]
        efforts = (load - jacobian.T @ forces)[6:]
        return Trajectory(np.tile(self.x0, (self.nodes + 1, 1)), np.tile(efforts, (self.nodes, 1)))

    def ours(self) -> ShootingProblem:
        """The problem for lgmpc."""
        dynamics = ContactForwardDynamics(self.robot.model, self.names)
        costs = [
            CostItem("com", CoMPosition(self.com), self.com_weight),
            CostItem("posture", StateError(dynamics.state, self.x_reference), self.state_weights),
            CostItem("effort", Control(dynamics.nu), self.effort_weight),
        ]
        problem = ShootingProblem(MultibodyAction("stance", dynamics, costs), self.nodes)
        problem.set("duration", self.dt)
        problem.set("contact_points", self.feet.ravel())
        problem.set("contact_gains", GAINS)
        problem.set_initial_state(self.x0)
        return problem

    def theirs(self) -> Any:
        """The problem for Crocoddyl."""
        import crocoddyl

        state = crocoddyl.StateMultibody(self.robot.model)
        nu = state.nv - 6
        contacts = crocoddyl.ContactModelMultiple(state, nu)
        for name, frame, point in zip(self.names, self.robot.contact_ids, self.feet, strict=True):
            contact = crocoddyl.ContactModel3D(state, frame, point, pin.LOCAL_WORLD_ALIGNED, nu, GAINS)
            contacts.addContact(name, contact)
        costs = crocoddyl.CostModelSum(state, nu)
        weighted(costs, "com", crocoddyl.ResidualModelCoMPosition(state, self.com, nu), np.full(3, self.com_weight))
        weighted(costs, "posture", crocoddyl.ResidualModelState(state, self.x_reference, nu), self.state_weights)
        weighted(costs, "effort", crocoddyl.ResidualModelControl(state, nu), np.full(nu, self.effort_weight))
        actuation = crocoddyl.ActuationModelFloatingBase(state)
        action = crocoddyl.DifferentialActionModelContactFwdDynamics(state, actuation, contacts, costs, 0.0, True)
        running = crocoddyl.IntegratedActionModelEuler(action, self.dt)
        terminal = crocoddyl.IntegratedActionModelEuler(action, 0.0)
        return crocoddyl.ShootingProblem(self.x0, [running] * self.nodes, terminal)


@dataclass(frozen=True)
class Trot(Stance):
    """A robot takes a step with each foot, in groups: contacts, footholds and swings change on the way.

    Unless given otherwise Solo12 trots. Friction is a soft cone, and low enough to matter. Here the contacts are flags,
    and all nodes have the same action; there each phase has a model of its own.

    Attributes:
        swings: indices of the feet that swing together, group after group.
        stand: intervals on four feet, before, between and after the swings.
        swing: intervals of each swing.
        stride: how far each foot goes, m.
        height: how high it is lifted, m.
        friction: coefficient of the cones.
        cone_weight: of their violations.
        swing_weight: of the swinging feet's places.
        effort_limit: hard bound of the torques, N.m.
    """

    dt: float = 0.015
    swings: tuple[tuple[int, ...], ...] = ((0, 3), (1, 2))
    stand: int = 4
    swing: int = 10
    stride: float = 0.05
    height: float = 0.04
    friction: float = 0.3
    cone_weight: float = 10.0
    swing_weight: float = 1e4
    effort_limit: float = np.inf
    nodes: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        """Count the intervals."""
        groups = len(self.swings)
        object.__setattr__(self, "nodes", (groups + 1) * self.stand + groups * self.swing)

    @property
    def x0(self) -> np.ndarray:
        """(nx,) at rest."""
        return self.x_reference

    @cached_property
    def com(self) -> np.ndarray:
        """(3,) where the centre of mass shall be: a stride ahead."""
        model = self.robot.model
        com = pin.centerOfMass(model, model.createData(), self.robot.q_reference)
        return np.asarray(com + [self.stride, 0.0, 0.0])

    @cached_property
    def flags(self) -> np.ndarray:
        """(N+1, 4) which feet stand."""
        flags = np.ones((self.nodes + 1, 4))
        for i, feet in enumerate(self.swings):
            start = self.stand + i * (self.stand + self.swing)
            flags[start : start + self.swing, feet] = 0.0
        return flags

    @cached_property
    def points(self) -> np.ndarray:
        """(N+1, 4, 3) where the feet shall be: held while they stand, on an arc while they swing, m."""
        points = np.tile(self.feet, (self.nodes + 1, 1, 1))
        for foot in range(4):
            swing = np.flatnonzero(self.flags[:, foot] == 0.0)
            phase = (swing - swing[0] + 1) / self.swing
            points[swing, foot, 0] += self.stride * phase
            points[swing, foot, 2] += self.height * np.sin(np.pi * phase)
            points[swing[-1] + 1 :, foot, 0] += self.stride
        return points

    def ours(self) -> ShootingProblem:
        """The problem for lgmpc."""
        dynamics = ContactForwardDynamics(self.robot.model, self.names)
        inside = QuadraticBarrier(0.0, np.inf)
        costs = [
            CostItem("com", CoMPosition(self.com), self.com_weight),
            CostItem("posture", StateError(dynamics.state, self.x_reference), self.state_weights),
            CostItem("effort", Control(dynamics.nu), self.effort_weight),
            *(CostItem(f"cone_{f}", FrictionCone(f, 4, self.friction), self.cone_weight, inside) for f in self.names),
            *(CostItem(f"swing_{f}", FrameTranslation(f)) for f in self.names),
        ]
        limit = self.effort_limit
        bounds = [ConstraintItem("motors", Control(dynamics.nu), -limit, limit)] if np.isfinite(limit) else []
        problem = ShootingProblem(MultibodyAction("trot", dynamics, costs, bounds), self.nodes)
        problem.set("duration", self.dt)
        problem.set("contact_flags", self.flags)
        problem.set("contact_points", self.points.reshape(self.nodes + 1, 12))
        problem.set("contact_gains", GAINS)
        for i, foot in enumerate(self.names):
            problem.set(f"swing_{foot}_reference", self.points[:, i])
            problem.set(f"swing_{foot}_weight", np.repeat(self.swing_weight * (1.0 - self.flags[:, i, None]), 3, 1))
        problem.set_initial_state(self.x0)
        return problem

    def theirs(self) -> Any:
        """The problem for Crocoddyl."""
        import crocoddyl

        state = crocoddyl.StateMultibody(self.robot.model)
        models = [self._node(state, k) for k in range(self.nodes + 1)]
        running = [crocoddyl.IntegratedActionModelEuler(model, self.dt) for model in models[:-1]]
        return crocoddyl.ShootingProblem(self.x0, running, crocoddyl.IntegratedActionModelEuler(models[-1], 0.0))

    def _node(self, state: Any, k: int) -> Any:
        import crocoddyl

        nu, last = state.nv - 6, k == self.nodes
        contacts, costs = crocoddyl.ContactModelMultiple(state, nu), crocoddyl.CostModelSum(state, nu)
        cone = crocoddyl.FrictionCone(np.eye(3), self.friction, 4, True, 0.0, np.inf)
        for i, (foot, frame) in enumerate(zip(self.names, self.robot.contact_ids, strict=True)):
            point = self.points[k, i]
            if self.flags[k, i] == 0.0:
                place = crocoddyl.ResidualModelFrameTranslation(state, frame, point, nu)
                weighted(costs, f"swing_{foot}", place, np.full(3, self.swing_weight))
                continue
            contact = crocoddyl.ContactModel3D(state, frame, point, pin.LOCAL_WORLD_ALIGNED, nu, GAINS)
            contacts.addContact(foot, contact)
            if not last:
                bounds = crocoddyl.ActivationBounds(cone.lb, cone.ub)
                force = crocoddyl.ResidualModelContactFrictionCone(state, frame, cone, nu)
                barrier = crocoddyl.ActivationModelQuadraticBarrier(bounds)
                costs.addCost(f"cone_{foot}", crocoddyl.CostModelResidual(state, barrier, force), self.cone_weight)
        weighted(costs, "com", crocoddyl.ResidualModelCoMPosition(state, self.com, nu), np.full(3, self.com_weight))
        weighted(costs, "posture", crocoddyl.ResidualModelState(state, self.x_reference, nu), self.state_weights)
        weighted(costs, "effort", crocoddyl.ResidualModelControl(state, nu), np.full(nu, self.effort_weight))
        actuation = crocoddyl.ActuationModelFloatingBase(state)
        model = crocoddyl.DifferentialActionModelContactFwdDynamics(state, actuation, contacts, costs, 0.0, True)
        if np.isfinite(self.effort_limit):
            model.u_lb, model.u_ub = np.full(nu, -self.effort_limit), np.full(nu, self.effort_limit)
        return model


ANYMAL_GAITS: dict[str, tuple[tuple[int, ...], ...]] = {
    "walk": ((3,), (1,), (2,), (0,)),
    "trot": ((0, 3), (1, 2)),
    "pace": ((0, 2), (1, 3)),
    "bound": ((0, 1), (2, 3)),
    "jump": ((0, 1, 2, 3),),
}


def anymal_gait(name: str, effort_limit: float = np.inf) -> Trot:
    """ANYmal C takes a step with each foot, in the order of a gait."""
    flight = name == "jump"
    return Trot(
        robot=anymal(),
        dt=0.02,
        swings=ANYMAL_GAITS[name],
        stand=12 if flight else 4,
        swing=12,
        stride=0.1,
        height=0.05 if flight else 0.08,
        friction=0.7,
        com_weight=1e3,
        effort_weight=1e-3,
        cone_weight=0.1,
        swing_weight=1e4,
        effort_limit=effort_limit,
    )
