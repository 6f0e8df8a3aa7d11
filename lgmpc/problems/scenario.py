"""Scenarios: optimal control problems with initial guesses and figures of merit."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from lgmpc.errors import InputError
from lgmpc.ocp import ShootingProblem, Trajectory
from lgmpc.robot import Robot
from lgmpc.settings import Settings
from lgmpc.typing import Array, BoolArray


class ProblemSettings(Settings):
    """Settings of a problem; ``kind`` is the name by which a config selects it."""

    kind: str


@dataclass(frozen=True)
class Waypoint:
    """A target at a time, drawn in the replay.

    Attributes:
        name: name in the replay.
        time: time of the target, s.
        position: (3,) world, m.
        rotation: (3, 3) world from frame; None for a position only.
    """

    name: str
    time: float
    position: Array
    rotation: Array | None = None


@dataclass(frozen=True, eq=False)
class Controls:
    """Names, unit and limits of the controls.

    Attributes:
        names: (nu,) names in figures and replays.
        unit: unit of all controls.
        lower: (nu,) lower limits.
        upper: (nu,) upper limits.

    Raises:
        InputError: different numbers of names and limits.
    """

    names: tuple[str, ...]
    unit: str
    lower: Array
    upper: Array

    def __post_init__(self) -> None:
        for side in ("lower", "upper"):
            if getattr(self, side).shape != (len(self.names),):
                raise InputError(side, f"shape {getattr(self, side).shape}", f"shape {(len(self.names),)}")

    @classmethod
    def joints(cls, robot: Robot) -> "Controls":
        """Return the efforts of a robot's joints as controls."""
        limit = np.array(robot.effort_limit)
        return cls(robot.joint_names, "N.m", -limit, limit)

    def ratio(self, us: Array) -> float:
        """Return the largest ratio of controls (N, nu) to the limit on their side; above 1 is beyond it."""
        limit = np.where(us > 0.0, self.upper, self.lower)
        return float(np.max(np.abs(us) / np.maximum(np.abs(limit), 1e-12), initial=0.0))


@dataclass(frozen=True, eq=False)
class Scenario:
    """A shooting problem of a robot, an initial guess, and the figures of merit of a solution.

    Attributes:
        name: a C identifier.
        robot: the robot; states begin with its configuration and velocity.
        problem: the optimal control problem.
        guess: initial trajectory of the solvers.
        durations: (N,) length of each interval, s; 0 for an impact.
        figures: from states and controls to figures of merit by name, which ends in the unit (``_m``, ``_deg``,
            ``_nm``, ``_ratio``).
        contact_flags: (N, nc) which of the robot's contact frames are on the ground in each interval.
        contact_forces: from states and controls to the (N, nc, 3) forces on the robot, world axes, N; None if there
            are no contacts.
        waypoints: targets, for the replay.
        controls: names and limits of the controls; unless given the joints' efforts, if there are as many.
        friction: coefficient of the contact forces' cones; None for a problem without.
        lengths: from states and controls to the (N,) lengths of the intervals, s, where these are free; None where they
            are the durations.
        remarks: from states and controls to sentences about the solution; None for none.

    Raises:
        InputError: durations, flags or names of controls whose number is not the problem's.
    """

    name: str
    robot: Robot
    problem: ShootingProblem
    guess: Trajectory
    durations: Array
    figures: Callable[[Trajectory], Mapping[str, float]]
    contact_flags: BoolArray = field(default_factory=lambda: np.zeros((0, 0), dtype=np.bool_))
    contact_forces: Callable[[Trajectory], Array] | None = None
    waypoints: tuple[Waypoint, ...] = ()
    controls: Controls | None = None
    friction: float | None = None
    lengths: Callable[[Trajectory], Array] | None = None
    remarks: Callable[[Trajectory], tuple[str, ...]] | None = None

    def __post_init__(self) -> None:
        nodes, nc = self.problem.nodes, self.robot.nc
        if self.contact_flags.size == 0:
            object.__setattr__(self, "contact_flags", np.zeros((nodes, nc), dtype=np.bool_))
        for name, shape in (("durations", (nodes,)), ("contact_flags", (nodes, nc))):
            got = getattr(self, name).shape
            if got != shape:
                raise InputError(name, f"shape {got}", f"shape {shape}")
        if self.controls is None and self.problem.nu == self.robot.nu:
            object.__setattr__(self, "controls", Controls.joints(self.robot))
        if self.controls is not None and len(self.controls.names) != self.problem.nu:
            raise InputError("controls", f"{len(self.controls.names)} names", f"{self.problem.nu}, one a control")

    def __repr__(self) -> str:
        targets = ", ".join(waypoint.name for waypoint in self.waypoints) or "none"
        horizon = f"{self.robot.name}, {self.durations.sum():.3g} s"
        return f"<Scenario {self.name}: {horizon}, targets: {targets}, {self.problem}>"

    @property
    def times(self) -> Array:
        """(N+1,) time of every node, s, from 0; an impact's two nodes have the same."""
        return np.concatenate([[0.0], np.cumsum(self.durations)])

    def times_of(self, trajectory: Trajectory) -> Array:
        """Return (N+1,) the time of every node of a trajectory, s: :attr:`times`, unless durations are free."""
        if self.lengths is None:
            return self.times
        return np.concatenate([[0.0], np.cumsum(self.lengths(trajectory))])
