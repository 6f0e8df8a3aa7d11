"""Receding-horizon control of centre of mass and momenta by contact forces."""

import time
from typing import Literal

import casadi as ca
import numpy as np

from lgmpc.actions import CentroidalAction
from lgmpc.compile import StageKernel
from lgmpc.lie.symbolic import quaternion, so3
from lgmpc.locomotion.horizon import ContactHorizon, MotionReference
from lgmpc.mpc.compiled import NOT_FINITE, OVERFLOWN, SOLVED, CompiledUpdate
from lgmpc.mpc.interface import MeasuredState
from lgmpc.mpc.plan import Plan
from lgmpc.mpc.settings import CentroidalWeights, MpcSettings
from lgmpc.mpc.sqp import SqpMpc, checked_mass, input_error, write_intervals
from lgmpc.ocp import ShootingProblem, Trajectory
from lgmpc.robot import Robot
from lgmpc.robot.friction import chosen_facets
from lgmpc.settings import NonNegative, Settings, Vector3, key
from lgmpc.solvers import Solution
from lgmpc.status import Status
from lgmpc.timegrid import TimeGrid
from lgmpc.typing import GRAVITY, Array, typed


class CentroidalSteppingWeights(Settings):
    """Weights that replace those of the cost while a foot is in the air within the horizon."""

    com: Vector3 = key(
        (1e2, 1e2, 3e3), "Position of the centre of mass [x, y, z], 1/m2; low in x and y: steps return a pushed robot."
    )


class CentroidalCatchingWeights(Settings):
    """Weights that replace those of stepping while a robot that stood steps against a push, until it stands again."""

    com: Vector3 = key(
        (1e2, 1e2, 3e4),
        "Position of the centre of mass [x, y, z], 1/m2; high in z: the feet of a robot that rises while it"
        " brakes lose the ground.",
    )


class CentroidalMpcSettings(MpcSettings):
    """Model-predictive control of the momenta by contact forces over a receding horizon."""

    model: Literal["centroidal"] = key("centroidal", "Model that predicts.")
    uprighting_rate_hz: NonNegative = key(10.0, "Rate at which the plan turns a tilted base upright, 1/s.")
    weights: CentroidalWeights = key(CentroidalWeights(), "Weights of the cost.")
    stepping_weights: CentroidalSteppingWeights = key(CentroidalSteppingWeights(), "Weights while the robot steps.")
    catching_weights: CentroidalCatchingWeights = key(
        CentroidalCatchingWeights(), "Weights of the cost while it steps against a push."
    )


class CentroidalReference:
    """Writes centre of mass and momenta over the horizon, in one compiled call.

    A base turned from its reference by the angle ``theta`` (body axes) is turned back with the angular momentum
    ``I rate exp(-rate t) theta``, besides that of the reference's own angular velocity.

    Args:
        target: (N+1, 9) [centre of mass; linear momentum; angular momentum], where the reference is written.
        mass: of the robot, kg.
        uprighting_rate: 1/s.
        grid: intervals of the horizon.

    Raises:
        CompileError: the compiler failed.
    """

    def __init__(self, target: Array, mass: float, uprighting_rate: float, grid: TimeGrid) -> None:
        nodes = len(target)
        self._motion = tuple(np.zeros((3, nodes, 3)))
        self._attitude, self._rotation, self._inertia = np.zeros(4), np.zeros((3, 3)), np.zeros((3, 3))
        fading = uprighting_rate * np.exp(-TimeGrid(uprighting_rate * grid.period, grid.count).elapsed)
        com, com_velocity, angular_velocity = self._motion
        turn, rotation = np.zeros(3), self._rotation.reshape(-1)
        self._turn = StageKernel.of(_turn).bind(1, attitude=self._attitude, rotation=rotation, turn=turn)
        self._run = StageKernel.of(_centroidal_reference).bind(
            nodes, com=com, com_velocity=com_velocity, angular_velocity=angular_velocity, fading=fading[:, None],
            mass=np.array([mass]), turn=turn, rotation=rotation, inertia=self._inertia.reshape(-1), x_reference=target,
        )  # fmt: skip

    def write(self, state: MeasuredState, reference: MotionReference) -> None:
        """Write the reference at the measured state.

        Raises:
            ValueError: an array of the wrong shape.
        """
        given = (reference.com, reference.com_velocity, reference.angular_velocity)
        for mine, theirs in zip(self._motion, given, strict=True):
            if theirs.shape != mine.shape:
                raise ValueError(f"shape {theirs.shape} of the reference instead of {mine.shape}")
            mine[...] = theirs
        self._attitude[:] = reference.q[0, 3:7]
        self._rotation[...] = state.rotation
        self._inertia[...] = state.inertia
        self._turn()
        self._run()


class CentroidalMpc(SqpMpc):
    """Plans contact forces over a horizon from the measured state.

    See :class:`~lgmpc.mpc.sqp.SqpMpc` for the steps of each :meth:`update`, and for failures. Only the forces are
    constrained, so every update has a feasible solution. The model has neither base nor joints; a tilted base is turned
    upright by the angular momentum of :class:`CentroidalReference`.

    Args:
        mass: of the robot, kg.
        contacts: number of contact points, nc.
        settings: horizon, weights, limits.
        feet: number of contact points of each foot; every point is a foot unless given.
        gravity: (3,) world axes, m/s^2.

    Raises:
        InputError: mass not positive, no contact, or gravity not three finite numbers.
        MissingDependencyError: the QP solver is not installed.
    """

    @typed
    def __init__(
        self,
        mass: float,
        contacts: int,
        settings: CentroidalMpcSettings | None = None,
        *,
        feet: tuple[int, ...] | None = None,
        gravity: tuple[float, float, float] | Array = (0.0, 0.0, -GRAVITY),
    ) -> None:
        s = CentroidalMpcSettings() if settings is None else settings
        mass = checked_mass(mass)
        soles = feet is not None and max(feet) > 1
        action = CentroidalAction(contacts, chosen_facets(s.friction_facets, soles), feet if soles else None)
        problem = ShootingProblem(action, s.nodes)
        problem.set("mass", mass)
        problem.set("gravity", gravity)
        problem.set("duration", s.node_s)
        lowest, highest = s.normal_force(mass)
        problem.set("normal_force_min", lowest)
        problem.set("normal_force_max", highest)
        super().__init__(problem, s, mass, -mass * np.asarray(gravity, dtype=np.float64))
        self._contacts = contacts
        self._standing_weight, self._stepping_weight, self._catching_weight = np.zeros((3, s.nodes + 1, 3))
        self.retune(s)
        view = problem.view
        self._points = view("contact_points").reshape(s.nodes + 1, contacts, 3)
        self._normals = view("contact_normals").reshape(s.nodes + 1, contacts, 3)
        self._friction = view("friction")
        self._wrench = view("external_wrench")
        self._x_reference = view("x_reference")
        self._com_weight = view("x_weight")[:, :3]
        self._reference = CentroidalReference(self._x_reference, mass, s.uprighting_rate_hz, s.horizon)
        self._u_reference = view("u_reference").reshape(s.nodes + 1, contacts, 3)
        self._compiled = CompiledUpdate.of(self)

    @classmethod
    def of(cls, robot: Robot, settings: CentroidalMpcSettings) -> "CentroidalMpc":
        """Return the controller of a robot; arguments and errors as of the class."""
        feet = tuple(len(foot.points) for foot in robot.feet)
        return cls(robot.mass, robot.nc, settings, feet=feet, gravity=robot.gravity)

    def retune(self, settings: CentroidalMpcSettings) -> None:
        """Change the weights of the cost, for the next update; other settings act at construction."""
        self.settings: CentroidalMpcSettings = settings
        s, problem = settings, self.problem
        problem.set("x_weight", s.weights.state(self.mass))
        problem.view("x_weight")[-1] *= s.weights.terminal
        problem.set("u_weight", s.weights.forces(self._contacts, self.mass))
        self._standing_weight[...] = problem.view("x_weight")[:, :3]
        self._stepping_weight[...] = s.stepping_weights.com
        self._catching_weight[...] = s.catching_weights.com
        for weight in (self._stepping_weight, self._catching_weight):
            weight[-1] *= s.weights.terminal

    def update(self, state: MeasuredState, contacts: ContactHorizon, reference: MotionReference, wrench: Array) -> Plan:
        """Plan from the measured momenta; see :meth:`lgmpc.mpc.interface.Mpc.update`."""
        start = time.perf_counter()
        compiled = self._compiled
        try:
            (self._write if compiled is None else compiled.write)(state, contacts, reference, wrench)
        except ValueError as error:
            raise input_error(error, self.settings.nodes, self._contacts) from error
        if compiled is None:
            return self._advance(state.time, start)
        status, iterations = compiled.run(self._guess_time)
        if status == NOT_FINITE:
            return self._fall_back(Status.NOT_FINITE, state.time, iterations, start)
        self._guess_time = state.time
        if status == OVERFLOWN:
            return self._fall_back(Status.FAILED, state.time, iterations, start)
        if status != SOLVED:
            return self._advance(state.time, start)
        plan = self._make_plan(state.time, compiled.states.copy(), compiled.forces.copy())
        self._trajectory = Trajectory(plan.xs, self.solver.us.copy())
        return self._keep(plan, Status.STEPPED, iterations, start)

    def _write(self, state: MeasuredState, contacts: ContactHorizon, reference: MotionReference, wrench: Array) -> None:
        problem = self.problem
        write_intervals(self._points, contacts.points)
        write_intervals(self._normals, contacts.normals)
        write_intervals(self._flags, contacts.flags)
        write_intervals(self._friction, contacts.friction)
        write_intervals(self._wrench, wrench)
        self._reference.write(state, reference)
        if reference.legs is not None:
            self._x_reference[:, 6:] += reference.legs
        problem.x0[0:3], problem.x0[3:9] = state.com, state.momentum
        if contacts.flags.all():
            self._com_weight[...], self._u_reference[...] = self._standing_weight, self._weight / self._contacts
        else:
            moving = self._catching_weight if reference.catching else self._stepping_weight
            self._com_weight[...], self._u_reference[...] = moving, self._shares()

    def _rest(self) -> Trajectory:
        n, nu = self.settings.nodes, self.problem.nu
        return Trajectory(np.tile(self.problem.x0, (n + 1, 1)), self._u_reference[:n].reshape(n, nu))

    def _describe(self, t: float, trajectory: Trajectory, result: Solution) -> Plan:
        n, nc = self.settings.nodes, self._contacts
        forces: Array = result.us.reshape(n, nc, 3) * self._flags[:n, :, None]
        return self._make_plan(t, trajectory.xs, forces)

    def _standing_plan(self, t: float) -> Plan:
        n = self.settings.nodes
        x = np.concatenate([np.nan_to_num(self._x_reference[0, :3]), np.zeros(6)])
        forces = np.nan_to_num(self._shares()[:n])
        return self._make_plan(t, np.tile(x, (n + 1, 1)), forces)


def _turn() -> ca.Function:
    """Return the rotation vector from a measured to a desired orientation; matrices are stored row by row."""
    attitude, stored = ca.SX.sym("attitude", 4), ca.SX.sym("rotation", 9)
    rotation = ca.reshape(stored, 3, 3).T
    turn = so3.log(ca.mtimes(rotation.T, quaternion.to_matrix(attitude)))
    return ca.Function("turn_to_reference", [attitude, stored], [turn], ["attitude", "rotation"], ["turn"])


def _centroidal_reference() -> ca.Function:
    """Return the reference at one node; matrices are stored row by row."""
    sizes = {"com": 3, "com_velocity": 3, "angular_velocity": 3, "fading": 1, "mass": 1, "turn": 3}
    s = {name: ca.SX.sym(name, size) for name, size in {**sizes, "rotation": 9, "inertia": 9}.items()}
    rotation, inertia = (ca.reshape(s[name], 3, 3).T for name in ("rotation", "inertia"))
    turning = s["fading"] * s["turn"] + ca.mtimes(rotation.T, s["angular_velocity"])
    x = ca.vertcat(s["com"], s["mass"] * s["com_velocity"], ca.mtimes(inertia, turning))
    return ca.Function("centroidal_reference", list(s.values()), [x], list(s), ["x_reference"])
