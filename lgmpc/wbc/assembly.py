"""The whole-body QP as one compiled function of state, targets and contacts, written into the solver's memory.

Variables ``z = (a, f)``: joint-space acceleration (nv,) and contact forces (3 nc,) on the robot, each in the axes of
the surface under its foot (two tangents and the normal), in which its cone and bounds are constant::

    minimise    1/2 ||J a - rhs||_W^2 + 1/2 w_f ||f - f_des||^2 + 1/2 w_a ||a||^2
    subject to  M_b a + h_b = J_cb^T f + w                      (floating-base rows of the dynamics)
                |M_j a + h_j + tau_f - J_cj^T f| <= tau_max      (torque limits)
                friction pyramid inscribed in the cone           (each foot)
                bounds on joint accelerations and forces         (joint limits, contact)

The known friction of the joints, ``tau_f``, depends on their measured speeds: the drives supply it on top.
Of feet in the air all force components have equal bounds, zero, which fixes them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from lgmpc.compile import StageKernel
from lgmpc.costs import StageSymbols
from lgmpc.robot import Robot
from lgmpc.robot.contact_points import ContactPoints
from lgmpc.robot.feet import UP
from lgmpc.robot.friction import friction_pyramid, joint_friction_torque
from lgmpc.typing import Array, BoolArray
from lgmpc.wbc.settings import WholeBodySettings
from lgmpc.wbc.solver import WholeBodySolver
from lgmpc.wbc.tasks import NumericTask, SymbolicTask, Task
from lgmpc.wbc.terms import WholeBodyTerms


@dataclass(frozen=True)
class Contacts:
    """Contact data of the QP, in buffers that are written at each tick.

    Attributes:
        stance: (nc,) whether each foot is in contact.
        friction: (nc,) assumed Coulomb coefficient.
        normals: (nc, 3) unit normals of the surfaces under the feet, world axes.
        target_forces: (nc, 3) reference of the forces, world axes, on the robot, N.
        lowest_normal: (nf,) normal force that a foot in contact keeps, N: of a sole, the sum over its corners.
        highest_normal: (nf,) normal force that a foot in contact may reach, N.
    """

    stance: BoolArray
    friction: Array
    normals: Array
    target_forces: Array
    lowest_normal: Array
    highest_normal: Array

    @classmethod
    def standing(cls, robot: Robot, settings: WholeBodySettings, normals: Array | None = None) -> "Contacts":
        """Return all feet in contact, the weight shared equally, within the limits of (scaled) settings.

        Args:
            robot: the robot.
            settings: scaled by the robot's mass.
            normals: (nc, 3) memory of the normals; of a level floor unless given.
        """
        nc = robot.nc
        assert settings.normal_force_n is not None
        forces = np.tile(robot.mass * -robot.gravity / nc, (nc, 1))
        lowest, highest = settings.normal_force_n
        return cls(
            np.ones(nc, dtype=np.bool_),
            np.full(nc, settings.friction),
            np.tile(np.array(UP), (nc, 1)) if normals is None else normals,
            forces,
            np.full(robot.nf, lowest),
            np.full(robot.nf, highest),
        )


class WholeBodyQp:
    """The QP's data, functions of all that may change between two ticks without compilation.

    Args:
        robot: the robot.
        settings: weights and limits, scaled by the robot's mass.
        tasks: the tasks, whose buffers the function reads; those without any weight are left out.
        solver: the data is written to its memory.
        terms: the sensed state.

    Attributes:
        contacts: see :class:`Contacts`.
        external_wrench: (6,) known or estimated [force; moment about the centre of mass] on the base, N and N.m.
        joint_load: (nu,) known or estimated torques on the legs of what pushes them, N.m.
        joint_friction: (nu,) Coulomb friction of the joints that the torques overcome, N.m; the robot's at first.
        joint_horizon: [look-ahead of the joints' limits, s; largest acceleration that they require, rad/s2].
        limits: (4, nu) limits of torque, lowest and highest position, and speed; the robot's at first.
        symbolic: the tasks with weights whose rows the function computes.
        numeric: those whose rows Python computes.
        facets: of the friction pyramid at each contact point.
        inputs: the buffers that a tick's function reads, in its order.
    """

    def __init__(
        self, robot: Robot, settings: WholeBodySettings, tasks: Sequence[Task], solver: WholeBodySolver,
        terms: WholeBodyTerms,
    ) -> None:  # fmt: skip
        nv, nu, base = robot.nv, robot.nu, robot.nv - robot.nu
        self.contacts = Contacts.standing(robot, settings, terms.normals)
        self.external_wrench = np.zeros(6)
        self.joint_load, self.joint_friction = np.zeros(nu), robot.joint_friction.copy()
        self.joint_horizon = np.array([settings.joint_horizon_s, settings.joint_acceleration_max_rad_s2])
        assert settings.friction_facets is not None
        self._terms, self._solver, self.facets = terms, solver, settings.friction_facets
        weighted = [task for task in tasks if task.weight.any()]
        self.numeric = [task for task in weighted if isinstance(task, NumericTask)]
        self.symbolic = symbolic = [task for task in weighted if isinstance(task, SymbolicTask)]
        self._flags = np.zeros(robot.nc)
        self._friction: list[float] = []
        self._bias = np.zeros(nu)
        self._summary = np.zeros(2)
        self._axes = np.zeros((3 * robot.nc, 3 * robot.nc))
        self._level = False
        self.limits = np.array(
            [robot.effort_limit, robot.joint_lower, robot.joint_upper, robot.velocity_limit], dtype=np.float64
        )
        weights, s = settings.weights, solver
        torque_rows, self._torques_without_bias = s.inequality[:nu], s.values[:nu]
        self._hessian, self._gradient = s.hessian[:nv, :nv], s.gradient[:nv]
        self._pyramids = [
            s.inequality[nu + i : nu + i + self.facets] for i in range(0, robot.nc * self.facets, self.facets)
        ]
        self._first_force, self._forces = nv, s.solution[nv:]
        s.hessian[nv:, nv:] = weights.force * np.eye(3 * robot.nc)
        pyramids = nu + robot.nc * self.facets
        s.upper[nu:pyramids] = 0.0
        patches = robot.foot_points
        for foot, (first, count) in enumerate(zip(patches.starts.tolist(), patches.counts.tolist(), strict=True)):
            if not patches.single:
                s.inequality[pyramids + foot, nv + 3 * first + 2 : nv + 3 * (first + count) : 3] = 1.0
        self.inputs = {
            "q": terms.q,
            "v": terms.v,
            "stance": self._flags,
            "normals": self.contacts.normals.reshape(-1),
            "target_forces": self.contacts.target_forces.reshape(-1),
            "lowest_normal": self.contacts.lowest_normal,
            "highest_normal": self.contacts.highest_normal,
            "external_wrench": self.external_wrench,
            "limits": self.limits.reshape(-1),
            "horizon": self.joint_horizon,
            "weights": np.array([weights.force, weights.acceleration]),
            "joint_load": self.joint_load,
            "joint_friction": self.joint_friction,
            **{f"task_{i}": task.memory for i, task in enumerate(symbolic)},
        }
        self._run = StageKernel.of(quadratic_programme, robot, symbolic).bind(
            1,
            **self.inputs,
            hessian=s.hessian[:nv].reshape(-1),
            gradient=s.gradient,
            equality=s.equality.reshape(-1),
            equality_rhs=s.equality_rhs,
            torque_rows=torque_rows.reshape(-1),
            lower=s.lower[:nu],
            upper=s.upper[:nu],
            box_lower=s.box_lower[base:],
            box_upper=s.box_upper[base:],
            **({} if patches.single else {"foot_lower": s.lower[pyramids:], "foot_upper": s.upper[pyramids:]}),
            bias=self._bias,
            summary=self._summary,
            axes=self._axes.reshape(-1),
        )

    @staticmethod
    def rows(robot: Robot, settings: WholeBodySettings) -> int:
        """Return the number of inequalities with (scaled) settings: torques, pyramids, and sums over soles."""
        assert settings.friction_facets is not None
        return robot.nu + settings.friction_facets * robot.nc + (0 if robot.foot_points.single else robot.nf)

    def update(self) -> float:
        """Write the QP of this tick into the solver's memory.

        Returns:
            The sum of squares of all that varies: not finite if the state or a target is not.
        """
        self._flags[...] = self.contacts.stance
        friction = self.contacts.friction.tolist()
        if friction != self._friction:
            self._write_friction(friction)
        self._run()
        magnitude, slope = self._summary.tolist()
        self._level = slope == 0.0
        return float(magnitude) + sum(map(self._add, self.numeric)) if self.numeric else magnitude

    def write_torques(self, torques: Array) -> None:
        """Write the joint torques (nu,) of the solver's solution: ``M_j a + h_j + tau_f - J_cj^T f``."""
        np.add(self._torques_without_bias, self._bias, out=torques)

    def write_forces(self, forces: Array) -> None:
        """Write the contact forces (3 nc,), world axes, of the solver's solution, N."""
        if self._level:  # the surfaces' axes are the world's
            forces[...] = self._forces
        else:
            np.dot(self._axes, self._forces, out=forces)

    def _write_friction(self, friction: list[float]) -> None:
        self._friction = friction
        for foot, (mu, rows) in enumerate(zip(friction, self._pyramids, strict=True)):
            column = self._first_force + 3 * foot
            rows[:, column : column + 3] = friction_pyramid(mu, self.facets)

    def _add(self, task: NumericTask) -> float:
        """Add the rows of a task in Python to the cost; return the sum of squares of their right-hand side."""
        task.update(self._terms)
        rhs, weighted = task.rhs, task.weight[:, None] * task.jacobian
        self._hessian += weighted.T @ task.jacobian
        self._gradient -= rhs @ weighted
        return float(rhs @ rhs)


def quadratic_programme(robot: Robot, tasks: Sequence[SymbolicTask]) -> ca.Function:
    """Return the data as a function; matrices are stored row by row, as in the solver."""
    model, nv, nu, nc = robot.symbolic, robot.nv, robot.nu, robot.nc
    base = nv - nu
    sizes = {"q": robot.nq, "v": nv, "stance": nc, "normals": 3 * nc, "target_forces": 3 * nc}
    sizes |= {"lowest_normal": robot.nf, "highest_normal": robot.nf, "external_wrench": 6}
    sizes |= {"limits": 4 * nu, "horizon": 2, "weights": 2, "joint_load": nu, "joint_friction": nu}
    sizes |= {f"task_{i}": task.layout.size for i, task in enumerate(tasks)}
    given = {name: ca.SX.sym(name, size) for name, size in sizes.items()}
    q, v = given["q"], given["v"]
    parameters = {"stance": given["stance"], "normals": given["normals"]}
    for i, task in enumerate(tasks):
        parameters |= {f"{task.name}_{key}": part for key, part in task.layout.split(given[f"task_{i}"]).items()}
    s = StageSymbols(model, ca.vertcat(q, v), parameters)
    contacts = ContactPoints(robot, q, v, given["normals"])
    axes = contacts.axes()

    hessian = given["weights"][1] * ca.SX.eye(nv)
    gradient = ca.SX.zeros(nv)
    for task in tasks:
        rows = task.rows(s)
        weighted = ca.mtimes(ca.diag(rows.weight), rows.jacobian)
        hessian += ca.triu(ca.mtimes(weighted.T, rows.jacobian))
        gradient -= ca.mtimes(weighted.T, rows.rhs)
    hessian = ca.triu2symm(hessian)
    gradient = ca.vertcat(gradient, -given["weights"][0] * ca.mtimes(axes.T, given["target_forces"]))

    dynamics, bias = ca.horzcat(model.crba(q), -ca.mtimes(contacts.jacobian().T, axes)), model.nle(q, v)
    rotation = model.joint_placement(q, 1).rotation
    force, moment = given["external_wrench"][:3], given["external_wrench"][3:]
    moment_on_base = moment + ca.cross(model.com(q) - q[:3], force)
    on_base = ca.vertcat(ca.mtimes(rotation.T, force), ca.mtimes(rotation.T, moment_on_base))
    effort, lowest, highest, fastest = ca.vertsplit(given["limits"], nu)
    rates = v[robot.joint_v]
    on_joints = bias[base:] + joint_friction_torque(given["joint_friction"], rates) - given["joint_load"]
    equality_rhs, lower, upper = on_base - bias[:base], -effort - on_joints, effort - on_joints
    joints = _joint_bounds(q[robot.joint_q], rates, lowest, highest, fastest, given["horizon"])
    feet = robot.foot_points.of.tolist()
    lowest_of_feet, highest_of_feet = given["lowest_normal"], given["highest_normal"]
    soles = not robot.foot_points.single
    forces = _force_bounds(given["stance"], ca.SX(nc, 1) if soles else lowest_of_feet, highest_of_feet[feet])
    box_lower, box_upper = ca.vertcat(joints[0], forces[0]), ca.vertcat(joints[1], forces[1])
    magnitude = sum(ca.sumsqr(part) for part in (q, v, gradient, equality_rhs, lower))
    outputs = {
        "hessian": ca.vertcat(hessian, ca.SX(3 * nc, nv)),
        "gradient": gradient,
        "equality": dynamics[:base, :].T,
        "equality_rhs": equality_rhs,
        "torque_rows": dynamics[base:, :].T,
        "lower": lower,
        "upper": upper,
        "box_lower": box_lower,
        "box_upper": box_upper,
        "bias": on_joints,
        "summary": ca.vertcat(magnitude, ca.sumsqr(ca.reshape(given["normals"], 3, nc)[:2, :])),
        "axes": ca.densify(axes.T),
    }
    if soles:
        stance = given["stance"][robot.foot_points.starts.tolist()]
        outputs |= {"foot_lower": stance * lowest_of_feet, "foot_upper": highest_of_feet}
    return ca.Function("wbc_qp", list(given.values()), ca.cse(list(outputs.values())), list(given), list(outputs))


def _joint_bounds(q: Any, v: Any, lowest: Any, highest: Any, fastest: Any, horizon: Any) -> tuple[Any, Any]:
    """Return bounds on the joint accelerations (nu,) that keep each joint within its limits.

    With ``T`` the joint horizon: ``a <= (v_max - v) / T`` and ``a <= 4 (q_max - q - v T) / T^2``, and the same from
    below. The second is the approach ``(d/dt + 2 / T)^2 (q_max - q) >= 0``, critically damped: a joint that begins no
    faster than ``2 (q_max - q) / T`` never passes the limit. A joint already past a limit is bound to at most the
    largest acceleration that the limits may require, and the two sides never cross.
    """
    time, cap = horizon[0], horizon[1]
    ahead, gain = q + time * v, 4.0 / time**2
    upper = ca.fmax(ca.fmin(gain * (highest - ahead), (fastest - v) / time), -cap)
    lower = ca.fmin(ca.fmax(gain * (lowest - ahead), (-fastest - v) / time), cap)
    return ca.fmin(lower, upper), upper


def _force_bounds(stance: Any, lowest: Any, highest: Any) -> tuple[Any, Any]:
    """Return bounds on the forces (3 nc,): of feet that can carry, the pyramid alone bounds the tangential parts."""
    carries = ca.logic_and(stance, highest > 0.0)
    # Not the negative of the upper bound: forces of feet in the air would be negative zeros.
    below, above = (ca.repmat(ca.if_else(carries, sign * WholeBodySolver.UNBOUNDED, 0.0).T, 2, 1) for sign in (-1, 1))
    normal_lower, normal_upper = (ca.if_else(carries, bound, 0.0).T for bound in (lowest, highest))
    return ca.vec(ca.vertcat(below, normal_lower)), ca.vec(ca.vertcat(above, normal_upper))
