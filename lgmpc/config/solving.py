"""The session that the config of a problem to solve describes: scenario and solver, run once, measured and judged."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from lgmpc.config.scenarios import build_scenario
from lgmpc.config.schema import SolveConfig
from lgmpc.config.session import Iteration, IterationReport, Notify, SolveOutcome
from lgmpc.errors import ConfigErrors, InputError
from lgmpc.ocp import KktResidual, Trajectory
from lgmpc.problems import Scenario
from lgmpc.problems.kinematics import com_positions, contact_positions
from lgmpc.runs import Outcome, TrajectoryLog, Verdict, judge_figures
from lgmpc.runs.figures import unknown_bounds
from lgmpc.solvers import (
    BoxFddp,
    Callback,
    Fddp,
    FddpSettings,
    IterativeSolver,
    LineSearchSqp,
    LineSearchSqpSettings,
    NlpSolver,
    Progress,
    Solution,
    Status,
)

__all__ = ["SolveSession", "build_solver", "check_scenario", "prepare_solve"]

Solve = Callable[[Trajectory, Callback], Solution]
"""From a guess to a solution, telling the callback after every iteration."""

_TOLERANCES = {"fddp": 1e-9, "box_fddp": 1e-9, "sqp": 1e-6, "ipopt": 1e-8, "fatrop": 1e-8}
_VERIFIED = 1e-6
"""Largest gap, violation (in the states' and constraints' own units) and gradient of the Lagrangian (relative to
1 + the largest multiplier) of a solution; larger if the solver was told."""
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


def prepare_solve(config: SolveConfig, *, notify: Notify = lambda message: None) -> SolveSession:
    """Build everything that a solve needs; compiles what never was on this machine.

    Args:
        config: what to solve.
        notify: told what is being prepared.

    Raises:
        LgmpcError: what cannot be built, naming the key.
    """
    notify("building the problem")
    scenario, _ = check_scenario(config)
    return SolveSession(config, scenario, build_solver(config, scenario, notify))


def build_solver(config: SolveConfig, scenario: Scenario, notify: Notify = lambda message: None) -> Solve:
    """Return what section ``solver`` says.

    Raises:
        ConfigError: a method that cannot take the problem's constraints.
    """
    section, problem = config.solver, scenario.problem
    method, most, limit = section.method, section.max_iterations, section.time_limit_s
    tolerance = _TOLERANCES[method] if section.tolerance is None else section.tolerance
    try:
        if method in ("ipopt", "fatrop"):
            nlp = NlpSolver(problem, method, tolerance=tolerance, max_iterations=most, progress=notify)
            if method == "fatrop":  # it can neither tell nor be stopped
                return lambda guess, callback: nlp.solve(guess)
            return lambda guess, callback: nlp.solve(guess, time_limit=limit, callback=callback)
        solver: IterativeSolver
        if method == "sqp":
            solver = LineSearchSqp(problem, LineSearchSqpSettings(tolerance=tolerance), progress=notify)
        else:
            kind = Fddp if method == "fddp" else BoxFddp
            solver = kind(problem, FddpSettings(tolerance=tolerance), progress=notify)
    except InputError as error:
        others = (
            "sqp, ipopt or fatrop" if method == "box_fddp" else "box_fddp (bounds on controls), sqp, ipopt or fatrop"
        )
        raise config.error("solver.method", f"{method} for {error.got}", others) from error
    return lambda guess, callback: solver.solve(guess, max_iterations=most, time_limit=limit, callback=callback)


def check_scenario(config: SolveConfig) -> tuple[Scenario, tuple[str, ...]]:
    """Build the problem, refuse bounds on figures that it has not, and return it with the names of all figures.

    Raises:
        LgmpcError: a problem that cannot be built; bounds on unknown figures, naming the nearest.
    """
    scenario = build_scenario(config)
    names = (*scenario.figures(scenario.guess), *_SOLVER_FIGURES)
    got, expected = "a bound on an unknown figure", "max_ or min_ and a figure of this problem"
    found = [
        config.error(
            f"gate.{bound}", got, expected, [f"gate.{bound[:4]}{name}" for name in names], word=f"gate.{bound}"
        )
        for bound in unknown_bounds(config.gate.bounds, names)
    ]
    if found:
        raise found[0] if len(found) == 1 else ConfigErrors(found)
    return scenario, names


@dataclass
class SolveSession:
    """A scenario and the solver for it.

    Attributes:
        config: what they were built from.
        scenario: the problem, its guess, and what success means.
        solve: the solver.
        iterations: what it told in the last run.
    """

    config: SolveConfig
    scenario: Scenario
    solve: Solve
    iterations: list[Progress] = field(default_factory=list)

    def run(self, report: IterationReport) -> SolveOutcome:
        """Solve from the scenario's guess.

        Args:
            report: called after every iteration. If it raises KeyboardInterrupt the solve ends there, and what it has
                is returned, marked as interrupted.
        """
        self.iterations.clear()
        interrupted = False

        def told(progress: Progress) -> bool:
            nonlocal interrupted
            self.iterations.append(progress)
            try:
                report(_iteration(progress))
            except KeyboardInterrupt:
                interrupted = True
            return interrupted

        solution = self.solve(self.scenario.guess, told)
        interrupted = interrupted and not solution.status.solved
        measured = solution.residual() if _finite(solution) else KktResidual.unknown()
        figures = self._figures(solution, measured)
        verdict = self._judge(solution, measured, figures, interrupted)
        status, explanation = solution.status, "" if solution.status.solved else solution.explain()
        return SolveOutcome(self._log(solution), figures, verdict, status.name.lower(), explanation)

    def _figures(self, solution: Solution, measured: KktResidual) -> dict[str, float]:
        """All figures, in the order in which they are shown; NaN where the trajectory is not finite."""
        scenario, milliseconds = self.scenario, 1e3 * solution.timings.total
        finite = _finite(solution)
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
        gate, status = self.config.gate, solution.status
        reasons = []
        if gate.converged and not status.solved:
            ending = status.name.lower().replace("_", " ")
            reasons.append(f"not converged: {ending} after {count}; {status.remedy}")
        if status.solved:
            reasons += _unconfirmed(measured, solution.scale, max(_VERIFIED, self.config.solver.tolerance or 0.0))
        reasons += judge_figures(figures, gate.bounds)
        return Verdict(Outcome.FAIL if reasons else Outcome.PASS, tuple(reasons))

    def _log(self, solution: Solution) -> TrajectoryLog:
        scenario, robot, told = self.scenario, self.scenario.robot, self.iterations
        problem, waypoints, finite = scenario.problem, scenario.waypoints, _finite(solution)
        nodes, nc = problem.nodes, robot.nc
        trajectory = solution.trajectory
        points, com = np.full((nodes + 1, nc, 3), np.nan), np.full((nodes + 1, 3), np.nan)
        forces = np.zeros((nodes, nc, 3))
        if finite:
            com[:] = com_positions(robot, trajectory.xs)
            points[:] = contact_positions(robot, trajectory.xs) - [0.0, 0.0, robot.contact_radius]
            if scenario.contact_forces is not None:
                forces[:] = scenario.contact_forces(trajectory)
        controls = scenario.controls
        unknown = np.full(problem.nu, np.inf)
        names = controls.names if controls is not None else tuple(f"u{i}" for i in range(problem.nu))
        rotations = [np.full((3, 3), np.nan) if w.rotation is None else w.rotation for w in waypoints]
        return TrajectoryLog(
            times=scenario.times,
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
            iteration_cost=np.array([p.cost for p in told]),
            iteration_criterion=np.array([p.criterion for p in told]),
            iteration_gap=np.array([p.gap for p in told]),
            iteration_step=np.array([p.step_length if p.accepted else 0.0 for p in told]),
            iteration_regularization=np.array([p.regularization for p in told]),
            iteration_elapsed=np.array([p.elapsed for p in told]),
            control_unit="" if controls is None else controls.unit,
            nq=robot.nq,
            floating_base=robot.floating_base,
            friction=math.nan if scenario.friction is None else scenario.friction,
        )


def _unconfirmed(measured: KktResidual, scale: float, tolerance: float) -> list[str]:
    """What the solver called solved, but the problem's own equations, evaluated anew, do not confirm."""
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


def _finite(solution: Solution) -> bool:
    fine = solution.status is not Status.NOT_FINITE
    return fine and bool(np.isfinite(solution.xs).all() and np.isfinite(solution.us).all())


def _iteration(progress: Progress) -> Iteration:
    return Iteration(
        progress.iteration,
        progress.cost,
        progress.criterion,
        progress.gap,
        progress.step_length if progress.accepted else 0.0,
        progress.regularization,
        progress.elapsed,
    )
