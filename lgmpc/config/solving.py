"""The session of a problem to solve: scenario and solver, run once, measured and judged.

Solutions of user-defined problems have the form of a run folder's content too, for replays and figures.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import casadi as ca
import numpy as np
import pinocchio as pin

from lgmpc.actions import Action, ImpulseAction, MultibodyAction
from lgmpc.actions.contacts import ContactSet
from lgmpc.compile import reporting
from lgmpc.config.robots import build_any_robot
from lgmpc.config.schema import SolveConfig
from lgmpc.config.session import IterationReport, Notify, SolveOutcome
from lgmpc.errors import InputError, as_one_error
from lgmpc.ocp import KktResidual, ShootingProblem, Trajectory
from lgmpc.problems import Scenario, build_problem
from lgmpc.problems.motion import com_positions, contact_positions
from lgmpc.robot import Robot
from lgmpc.runs import Outcome, SolvedRun, SolveGate, SolveResult, TrajectoryLog, Verdict, judge_figures
from lgmpc.runs.figures import unknown_bounds
from lgmpc.solvers import History, Progress, Solution, Solver, Status, check_method, make_solver
from lgmpc.typing import Array, BoolArray


def build_scenario(config: SolveConfig) -> Scenario:
    """Load the robot and build the problem.

    Raises:
        ConfigError: an unknown robot, or a problem that does not suit this robot.
        ModelError: with everything that the model lacks.
    """
    robot = build_any_robot(config)
    try:
        return build_problem(robot, config.problem)
    except InputError as error:
        of_robot = error.argument.partition(".")[0] == "robot"
        key = error.argument if of_robot else f"problem.{error.argument}"
        raise config.error(key, error.got, error.expected, error.choices) from error


def trajectory_log(scenario: Scenario, solution: Solution, iterations: Sequence[Progress]) -> TrajectoryLog:
    """Return the trajectory with its centre of mass, contacts and forces; NaN where it is not finite.

    Args:
        scenario: the problem.
        solution: its solution, converged or not.
        iterations: the solver's reports.
    """
    robot, problem, waypoints, finite = scenario.robot, scenario.problem, scenario.waypoints, is_finite(solution)
    nodes, nc = problem.nodes, robot.nc
    trajectory = solution.trajectory
    points, com = np.full((nodes + 1, nc, 3), np.nan), np.full((nodes + 1, 3), np.nan)
    forces = np.zeros((nodes, nc, 3))
    if finite:
        com[:] = com_positions(robot, trajectory.xs)
        points[:] = contact_positions(robot, trajectory.xs) + robot.foot_points.lever()
        if scenario.contact_forces is not None:
            forces[:] = scenario.contact_forces(trajectory)
    controls = scenario.controls
    unknown = np.full(problem.nu, np.inf)
    names = controls.names if controls is not None else tuple(f"u{i}" for i in range(problem.nu))
    rotations = [np.full((3, 3), np.nan) if w.rotation is None else w.rotation for w in waypoints]
    return TrajectoryLog(
        times=scenario.times_of(trajectory) if finite else scenario.times,
        xs=solution.xs.copy(),
        us=solution.us.copy(),
        com=com,
        contact_points=points,
        contact_flags=scenario.contact_flags.copy(),
        contact_forces=forces,
        contact_frames=np.array(robot.contact_frames, dtype=np.str_),
        control_names=np.array(names, dtype=np.str_),
        control_lower=-unknown if controls is None else controls.lower.copy(),
        control_upper=unknown if controls is None else controls.upper.copy(),
        waypoint_names=np.array([w.name for w in waypoints], dtype=np.str_),
        waypoint_times=np.array([w.time for w in waypoints], dtype=np.float64),
        waypoint_positions=np.array([w.position for w in waypoints], dtype=np.float64).reshape(-1, 3),
        waypoint_rotations=np.array(rotations, dtype=np.float64).reshape(-1, 3, 3),
        iteration_cost=np.array([p.cost for p in iterations]),
        iteration_criterion=np.array([p.criterion for p in iterations]),
        iteration_gap=np.array([p.gap for p in iterations]),
        iteration_step=np.array([p.step_length if p.accepted else 0.0 for p in iterations]),
        iteration_regularization=np.array([p.regularization for p in iterations]),
        iteration_elapsed=np.array([p.elapsed for p in iterations]),
        control_unit="" if controls is None else controls.unit,
        nq=robot.nq,
        floating_base=robot.floating_base,
        friction=math.nan if scenario.friction is None else scenario.friction,
    )


def is_finite(solution: Solution) -> bool:
    """Return whether all states and controls of a trajectory are finite."""
    fine = solution.status is not Status.NOT_FINITE
    return fine and bool(np.isfinite(solution.xs).all() and np.isfinite(solution.us).all())


_VERIFIED = 1e-6
"""Largest gap, violation (in the states' and constraints' own units) and gradient of the Lagrangian (relative to
1 + the largest multiplier) of a solution; the solver's tolerance where that is larger."""
_SOLVER_FIGURES = (
    "effort_ratio",
    "cost",
    "dynamics_gap",
    "constraint_violation",
    "stationarity",
    "complementarity",
    "iterations",
    "solve_ms",
    "ms_per_iteration",
)


def prepare_solve(config: SolveConfig, *, notify: Notify = lambda message: None) -> "SolveSession":
    """Build the session of a solve; compiles what is not in the cache.

    Args:
        config: the problem.
        notify: called with a description of what is being prepared.

    Raises:
        LgmpcError: what cannot be built, naming the key.
    """
    notify("building the problem")
    scenario, _ = check_scenario(config)
    with reporting(notify):
        return SolveSession(scenario, make_solver(scenario.problem, config.solver), config.gate)


def check_scenario(config: SolveConfig) -> tuple[Scenario, tuple[str, ...]]:
    """Build the problem, raise for a method or bounds that do not suit it, and return it with all figures' names.

    Raises:
        LgmpcError: a problem that cannot be built; a method that does not support its constraints; bounds on unknown
            figures, naming the nearest.
    """
    scenario = build_scenario(config)
    try:
        check_method(scenario.problem, config.solver)
    except InputError as error:
        bounds = "" if config.solver.method == "box_fddp" else "box_fddp (bounds on controls), "
        got = f"{config.solver.method} for {error.got}"
        raise config.error("solver.method", got, f"{bounds}al_fddp, sqp, ipopt or fatrop") from error
    names = (*scenario.figures(scenario.guess), *_SOLVER_FIGURES)
    got, expected = "a bound on an unknown figure", "max_ or min_ and a figure of this problem"
    found = [
        config.error(
            f"gate.{bound}", got, expected, [f"gate.{bound[:4]}{name}" for name in names], word=f"gate.{bound}"
        )
        for bound in unknown_bounds(config.gate.limits, names)
    ]
    if found:
        raise as_one_error(found)
    return scenario, names


@dataclass
class SolveSession:
    """A scenario and its solver.

    Attributes:
        scenario: the problem, its initial guess and its figures.
        solver: the solver.
        gate: the criteria of success.
        iterations: the solver's reports of the last run.
    """

    scenario: Scenario
    solver: Solver
    gate: SolveGate
    iterations: list[Progress] = field(default_factory=list)

    @property
    def log_bytes(self) -> int:
        """Size of the trajectory's arrays, B: states, controls, and for each contact a point and a force."""
        problem, contacts = self.scenario.problem, len(self.scenario.robot.contact_frames)
        return 8 * (problem.nodes + 1) * (problem.state.nx + problem.nu + 7 * contacts + 4)

    def run(self, report: IterationReport) -> SolveOutcome:
        """Solve from the scenario's initial guess.

        Args:
            report: called after every iteration. If it raises KeyboardInterrupt the solve ends there, and the current
                trajectory is returned, marked as interrupted.
        """
        self.iterations.clear()
        interrupted = False

        def record(progress: Progress) -> bool:
            nonlocal interrupted
            self.iterations.append(progress)
            try:
                report(progress)
            except KeyboardInterrupt:
                interrupted = True
            return interrupted

        silent = self.solver.settings.method == "fatrop"  # it neither reports its iterations nor can be interrupted
        solution = self.solver.solve(self.scenario.guess, callback=None if silent else record)
        interrupted = interrupted and not solution.status.solved
        measured = solution.residual() if is_finite(solution) else KktResidual.unknown()
        figures = self._figures(solution, measured)
        verdict = self._judge(solution, measured, figures, interrupted)
        log, status = trajectory_log(self.scenario, solution, self.iterations), solution.status
        remarks = self.scenario.remarks
        words = () if remarks is None or not is_finite(solution) else remarks(solution.trajectory)
        explanation = "\n".join(words if status.solved else (solution.explain(), *words))
        return SolveOutcome(log, figures, verdict, status.name.lower(), explanation, solution)

    def _figures(self, solution: Solution, measured: KktResidual) -> dict[str, float]:
        """Return all figures, in the order of display; NaN where the trajectory is not finite."""
        scenario, milliseconds = self.scenario, 1e3 * solution.timings.total
        finite = is_finite(solution)
        own: Mapping[str, float] = scenario.figures(solution.trajectory if finite else scenario.guess)
        controls = scenario.controls
        return {
            **(own if finite else dict.fromkeys(own, math.nan)),
            "effort_ratio": controls.ratio(solution.us) if controls is not None and finite else math.nan,
            "cost": solution.cost,
            "dynamics_gap": measured.dynamics,
            "constraint_violation": measured.constraint,
            "stationarity": measured.stationarity,
            "complementarity": measured.complementarity,
            "iterations": float(solution.iterations),
            "solve_ms": milliseconds,
            "ms_per_iteration": milliseconds / max(solution.iterations, 1),
        }

    def _judge(
        self, solution: Solution, measured: KktResidual, figures: Mapping[str, float], interrupted: bool
    ) -> Verdict:
        count = f"{solution.iterations} iteration{'' if solution.iterations == 1 else 's'}"
        if interrupted:
            return Verdict(Outcome.INTERRUPTED, (f"interrupted after {count}",))
        gate, status = self.gate, solution.status
        reasons = []
        if gate.converged and not status.solved:
            ending = status.name.lower().replace("_", " ")
            reasons.append(f"not converged: {ending} after {count}; {status.remedy}")
        if status.solved:
            reasons += _unconfirmed(measured, solution.scale, max(_VERIFIED, self.solver.settings.tolerance))
        reasons += judge_figures(figures, gate.limits)
        return Verdict(Outcome.FAIL if reasons else Outcome.PASS, tuple(reasons))


def _unconfirmed(measured: KktResidual, scale: float, tolerance: float) -> list[str]:
    """Return the reasons why the problem's equations, evaluated anew, do not confirm convergence."""
    parts = {
        "gaps of the dynamics": (measured.dynamics, tolerance),
        "violations of constraints": (measured.constraint, tolerance),
        "gradients of the Lagrangian": (measured.stationarity, tolerance * scale),
    }
    return [
        f"the solver converged, but {what} reach {value:.2g}, computed anew; allowed at most {most:.2g}"
        for what, (value, most) in parts.items()
        if not value <= most
    ]


def solution_as_run(
    subject: Scenario | Robot, solution: Solution, history: History | None = None
) -> tuple[Robot, SolvedRun]:
    """Return the robot, and a solution in the form of a run folder's content.

    Args:
        subject: the scenario, or the robot alone, see :func:`scenario_of`.
        solution: solution of a problem with this robot.
        history: the solver's reports.

    Raises:
        InputError: states of another robot.
    """
    scenario = subject if isinstance(subject, Scenario) else scenario_of(subject, solution)
    status = solution.status
    result = SolveResult(
        name=scenario.name,
        verdict=Verdict(Outcome.PASS) if status.solved else Verdict(Outcome.FAIL, (status.remedy,)),
        method="",
        status=status.name.lower(),
        explanation="" if status.solved else solution.explain(),
        figures={
            **(scenario.figures(solution.trajectory) if is_finite(solution) else {}),
            "cost": solution.cost,
            "iterations": float(solution.iterations),
            "solve_ms": 1e3 * solution.timings.total,
        },
    )
    log = trajectory_log(scenario, solution, () if history is None else history.reports)
    return scenario.robot, SolvedRun(Path(scenario.name), "", log, result)


def scenario_of(robot: Robot, solution: Solution) -> Scenario:
    """Return the scenario of a solution, as far as its problem's parameters determine it.

    Times follow from ``duration``, contacts from ``contact_flags``; forces are those of the actions' dynamics.

    Args:
        robot: robot whose configuration and velocity are the states.
        solution: solution of a problem with this robot.

    Raises:
        InputError: states of another robot, or intervals whose length no parameter says.
    """
    problem = solution.problem
    if problem.state.nx != robot.nq + robot.nv:
        expected = f"states of {robot.name}, nx = {robot.nq + robot.nv}"
        raise InputError("solution", f"states with nx = {problem.state.nx}", expected)
    durations = _durations(problem)
    if not durations.any():
        expected = "actions with the parameter 'duration', or a Scenario with durations in place of the robot"
        raise InputError("solution", f"intervals of no known length ('{problem.actions[0].name}')", expected)
    return Scenario(
        name=problem.actions[0].name,
        robot=robot,
        problem=problem,
        guess=solution.trajectory,
        durations=durations,
        figures=lambda trajectory: {},
        contact_flags=_flags(robot, problem),
        contact_forces=lambda trajectory: _forces(robot, problem, trajectory),
    )


def _durations(problem: ShootingProblem) -> Array:
    """Return (N,) durations of the intervals, s; 0 where the action has none."""
    found = np.zeros(problem.nodes)
    for k, action in enumerate(problem.actions):
        if "duration" in tuple(action.parameters):
            found[k] = problem.parameters[k, action.parameters["duration"]][0]
    return found


def _flags(robot: Robot, problem: ShootingProblem) -> BoolArray:
    """Return (N, nc) flags of the robot's contact frames that are active contacts of the action."""
    found = np.zeros((problem.nodes, robot.nc), dtype=np.bool_)
    for k, action in enumerate(problem.actions):
        contacts = _contacts(action)
        if contacts is None:
            continue
        flags = problem.parameters[k, action.parameters["contact_flags"]]
        for contact, flag in zip(contacts.contacts, flags, strict=True):
            if contact.frame in robot.contact_frames:
                found[k, robot.contact_frames.index(contact.frame)] = flag > 0.0
    return found


def _forces(robot: Robot, problem: ShootingProblem, trajectory: Trajectory) -> Array:
    """Return (N, nc, 3) forces on the robot's contact frames, N; zero during impacts, which have impulses."""
    found, data = np.zeros((problem.nodes, robot.nc, 3)), robot.create_data()
    for k, action in enumerate(problem.actions):
        contacts = _contacts(action)
        if contacts is None or action.expansion is None or isinstance(action, ImpulseAction):
            continue
        dynamics = action.expansion.dynamics
        p = problem.parameters[k, : dynamics.numel_in(2)]
        z = dynamics(trajectory.xs[k], trajectory.us[k, : action.nu], p)[1].full()[:, 0]
        flags = problem.parameters[k, action.parameters["contact_flags"]]
        pin.framesForwardKinematics(robot.model, data, trajectory.xs[k, : robot.nq])
        start = robot.nv
        for contact, flag in zip(contacts.contacts, flags, strict=True):
            if contact.frame in robot.contact_frames:
                own = z[start : start + contact.size]
                if contact.size < 3:
                    rotation = data.oMf[robot.model.getFrameId(contact.frame)].rotation
                    own = contact.directions(ca.DM(rotation)).full() @ own
                found[k, robot.contact_frames.index(contact.frame)] = flag * own[:3]
            start += contact.size
    return found


def _contacts(action: Action) -> ContactSet | None:
    owner = action.dynamics if isinstance(action, MultibodyAction) else action
    contacts = getattr(owner, "contacts", None)
    return contacts if isinstance(contacts, ContactSet) else None
