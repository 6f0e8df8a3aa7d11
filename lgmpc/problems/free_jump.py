"""A jump to a requested height, or as high as the motors allow, with phases of optimised durations.

Take-off, flight and landing are free phases (:class:`~lgmpc.ocp.FreeDurations`). The height is a cost at take-off, on
the apex of the parabola on which the centre of mass leaves the ground, so that a height beyond the motors' limits does
not make the problem infeasible: the robot jumps as high as they allow.
"""

import itertools
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import casadi as ca
import numpy as np
from pydantic import AfterValidator

from lgmpc.costs import CostItem, Parameter, Residual, StageSymbols
from lgmpc.locomotion.sequence import GaitGrid, GaitSequence
from lgmpc.ocp import FreeDurations, FreePhase, Trajectory
from lgmpc.problems import legged
from lgmpc.problems.footsteps import BaseLeap, Footsteps
from lgmpc.problems.ground import ProblemGround
from lgmpc.problems.legged_figures import LeggedFigures
from lgmpc.problems.legged_settings import JumpWeights, LeggedSettings
from lgmpc.problems.motion import com_positions, contact_positions
from lgmpc.problems.scenario import ProblemSettings, Scenario
from lgmpc.robot import Robot
from lgmpc.settings import Interval, NonNegative, Positive, key, problem as problem_with
from lgmpc.typing import Array, typed

_AT_LIMIT = 0.995  # ratio to a limit, or to the beginning of its barrier, from which it counts as reached
_PHASES = ("takeoff", "flight", "landing")


def _ordered(value: tuple[float, float]) -> tuple[float, float]:
    if value[0] > value[1]:
        raise problem_with("[shortest, longest] with shortest not above longest", got=list(value))
    return value


Range = Annotated[tuple[Positive, Positive], AfterValidator(_ordered)]


class FreeJumpSettings(LeggedSettings, ProblemSettings):
    """A robot jumps up, by a height or as far as its motors allow; the durations of the phases are optimised."""

    kind: Literal["jump_free_time"] = key("jump_free_time", "A robot jumps to a height, in phases of free durations.")
    com_rise_m: Positive = key(0.25, "Apex of the centre of mass above its initial height, m: reached, or approached.")
    takeoff_range_s: Range = key((0.15, 0.6), "[shortest, longest] time before the flight, s.")
    flight_range_s: Range = key((0.1, 0.8), "[shortest, longest] duration of the flight, s.")
    landing_range_s: Range = key((0.3, 1.0), "[shortest, longest] time after the landing, s.")
    height_m: NonNegative = key(0.05, "Apex of the feet's paths above the ground, m.")
    step_s: Interval = key(0.01, "Length of an interval, s, where durations are mid-range.")
    rise_weight: Positive = key(3e3, "Dimensionless weight of the squared deviation from com_rise_m.")
    weights: JumpWeights = key(JumpWeights(), "Weights of the cost.")

    def nominal_s(self, phase: str) -> float:
        """Return the duration of a phase from which its stretch is counted: the geometric mean of its range."""
        shortest, longest = getattr(self, f"{phase}_range_s")
        return float(np.sqrt(shortest * longest))


class _Apex(Residual):
    """Apex of the parabola of the centre of mass minus the reference, m."""

    nr = 1
    parameters = (Parameter("reference", 1, "height of the apex, against gravity from the world's origin, m"),)

    def __init__(self, robot: Robot) -> None:
        self._gravity, self._up = float(np.linalg.norm(robot.gravity)), tuple(robot.up.tolist())

    def expression(self, s: StageSymbols) -> Any:
        """Return the difference."""
        up = ca.DM(self._up)
        rate = ca.dot(up, s.robot.vcom(s.q, s.v))
        return ca.dot(up, s.com) + ca.if_else(rate > 0.0, rate, 0.0) ** 2 / (2.0 * self._gravity) - s["reference"]


@typed
def build_free_jump(robot: Robot, settings: FreeJumpSettings | None = None) -> Scenario:
    """Return the problem of a jump of free durations.

    Figures: those of :class:`LeggedFigures` with the durations of the solution, ``takeoff_s``, ``flight_s`` and
    ``landing_s``, and ``com_rise_shortfall_m``, the requested minus the reached rise of the centre of mass. Remarks
    name the limits that are reached before the flight.

    Raises:
        InputError: a robot without free base or contact frames.
    """
    s = FreeJumpSettings() if settings is None else settings
    legged.check_legged(robot)
    scale, ground = legged.LeggedScale.of(robot), ProblemGround(s.ground())
    start = contact_positions(robot, robot.x_reference[None])[0]

    def planned(takeoff: float, flight: float, landing: float) -> tuple[GaitSequence, BaseLeap, Footsteps]:
        gait = GaitSequence.jump(robot.contact_frames, takeoff, flight, landing, s.height_m)
        leap = BaseLeap(np.zeros(3), 0.0, takeoff, takeoff + flight, scale.gravity)
        steps = Footsteps.plan(gait, leap, start, robot.q_reference[:3])
        return gait, leap, ground.laid(steps, robot.foot_points.radius)

    gait, leap, steps = planned(*(s.nominal_s(phase) for phase in _PHASES))
    grid = gait.grid(s.step_s)
    reference = legged.reference_states(robot, leap, grid.times, ground, steps)
    apex = CostItem("apex", _Apex(robot), 0.0)
    fixed = legged.legged_problem(robot, grid, reference, steps, s, ground, (apex,))
    first_flight = int(np.flatnonzero(grid.flight)[0])
    first_landing = int(np.flatnonzero(grid.impacts)[-1]) + 1
    top = float(com_positions(robot, reference[:1])[0] @ robot.up) + s.com_rise_m
    fixed.set("apex_reference", top)
    # The running cost is multiplied by the interval's duration; the weight is per square of the leg's length.
    weight = s.rise_weight / scale.length**2 / grid.durations[first_flight]
    fixed.set("apex_weight", weight, [first_flight])
    begins = dict(zip(_PHASES, (0, first_flight, first_landing), strict=True))
    free = FreeDurations(
        fixed,
        [FreePhase(k, *(bound / s.nominal_s(n) for bound in getattr(s, f"{n}_range_s"))) for n, k in begins.items()],
    )

    def solved(trajectory: Trajectory) -> tuple[LeggedFigures, list[float]]:
        durations, edges = free.durations(trajectory), [*begins.values(), len(grid.durations)]
        spans = [float(durations[a:b].sum()) for a, b in itertools.pairwise(edges)]
        footsteps = planned(*spans)[2]
        timed = GaitGrid(durations, grid.flags, grid.touchdowns)
        return LeggedFigures(robot, timed, footsteps, reference[-1], s.friction, ground), spans

    def measure(trajectory: Trajectory) -> Mapping[str, float]:
        figures, spans = solved(trajectory)
        found = figures.measure(free.plain(trajectory))
        lengths_s = {f"{name}_s": span for name, span in zip(_PHASES, spans, strict=True)}
        return {**found, "com_rise_shortfall_m": s.com_rise_m - found["com_rise_m"], **lengths_s}

    def forces(trajectory: Trajectory) -> Array:
        lifted = np.zeros((free.problem.nodes, robot.nc, 3))
        lifted[~free.chosen] = solved(trajectory)[0].forces(free.plain(trajectory))
        return lifted

    def lengths(trajectory: Trajectory) -> Array:
        out = np.zeros(free.problem.nodes)
        out[~free.chosen] = free.durations(trajectory)
        return out

    def remarks(trajectory: Trajectory) -> tuple[str, ...]:
        return _remarks(robot, s, measure(trajectory), free.plain(trajectory), first_flight)

    flags = np.zeros((free.problem.nodes, robot.nc), dtype=np.bool_)
    flags[~free.chosen] = grid.flags
    gates = np.flatnonzero(free.chosen)
    flags[gates] = flags[gates + 1]
    guess = Trajectory(legged.resting_guess(robot, grid, reference), legged.carrying_efforts(robot, grid, reference[0]))
    return Scenario(
        name="jump_free_time",
        robot=robot,
        problem=free.problem,
        guess=free.lift(guess),
        durations=lengths(free.lift(guess)),
        figures=measure,
        contact_flags=flags,
        contact_forces=forces,
        friction=s.friction,
        lengths=lengths,
        remarks=remarks,
    )


def _remarks(
    robot: Robot, settings: FreeJumpSettings, figures: Mapping[str, float], plain: Trajectory, flight: int
) -> tuple[str, ...]:
    """Return sentences on the height and on the limits that are reached before the flight."""
    rise, requested = figures["com_rise_m"], settings.com_rise_m
    efforts = np.abs(plain.us[:flight]) / robot.effort_limit
    rates = np.abs(plain.xs[: flight + 1, robot.nq :][:, robot.joint_v]) / robot.velocity_limit
    bound = [
        f"{label} of {', '.join(np.array(robot.joint_names)[reached])}"
        for label, reached in (
            ("torque", efforts.max(axis=0) >= _AT_LIMIT),
            ("speed", rates.max(axis=0) >= legged.SPEED_USED * _AT_LIMIT),
        )
        if reached.any()
    ]
    spans = []
    for name in _PHASES:
        shortest, longest = getattr(settings, f"{name}_range_s")
        took = figures[f"{name}_s"]
        end = "shortest" if took <= shortest / _AT_LIMIT else "longest" if took >= longest * _AT_LIMIT else ""
        spans.append(f"{name} {took:.3f} s{f' (the {end} allowed)' if end else ''}")
    short = f"{1e2 * (requested - rise):.1f} cm less than requested" if rise < requested - 1e-3 else "as requested"
    return (
        f"The centre of mass rises by {1e2 * rise:.1f} cm, {short}; {', '.join(spans)}.",
        f"Limits reached before the flight: {'; '.join(bound) if bound else 'none'}.",
    )
