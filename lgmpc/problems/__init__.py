"""Ready-made optimal control problems.

A builder takes a robot and settings, and returns a :class:`Scenario`: the shooting problem, an initial guess, and the
figures of merit of a solution.

    scenario = build_gait(robot, GaitSettings(pattern="walk", cycles=2))
    solution = BoxFddp(scenario.problem).solve(scenario.guess)
    print(scenario.figures(solution.trajectory))

Other gaits are sequences of phases (:class:`~lgmpc.locomotion.sequence.GaitSequence`); :func:`build_legged` combines
any of them with any motion of the base. ``reactions`` and ``soles`` compute forces and margins of any trajectory by
Pinocchio.

A new kind of configs is one file, with its settings (``kind: Literal["<kind>"]`` among them) and a function that builds
a :class:`Scenario` from a robot and these settings, and one line in ``_builders``. ``lgmpc schema >
configs/schema.json`` then writes the schema for editors.
"""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Annotated, Any, Union

from pydantic import Field

from lgmpc.errors import InputError
from lgmpc.lie.checks import typed
from lgmpc.locomotion.sequence import GaitPhase
from lgmpc.problems.flight import (
    FlightSettings,
    FlightWaypoint,
    FlightWeights,
    Multirotor,
    MultirotorSettings,
    build_flight,
)
from lgmpc.problems.footsteps import BaseLeap, BaseMotion, BasePath, Footsteps
from lgmpc.problems.free_jump import FreeJumpSettings, build_free_jump
from lgmpc.problems.legged import build_gait, build_jump, build_legged
from lgmpc.problems.legged_settings import GaitSettings, JumpSettings, JumpWeights, LeggedSettings, LeggedWeights
from lgmpc.problems.reach import ReachSettings, ReachWeights, build_reach
from lgmpc.problems.righting import LegStrokes, RightingSettings, RightingWeights, build_righting
from lgmpc.problems.scenario import Controls, ProblemSettings, Scenario, Waypoint
from lgmpc.problems.standing_reach import StandingReachSettings, StandingReachWeights, build_standing_reach
from lgmpc.robot import Robot

__all__ = [
    "AnyProblemSettings",
    "JumpWeights",
    "ProblemSettings",
    "build_problem",
    "BaseLeap",
    "BaseMotion",
    "BasePath",
    "Controls",
    "FlightSettings",
    "FlightWaypoint",
    "FlightWeights",
    "Footsteps",
    "FreeJumpSettings",
    "GaitPhase",
    "GaitSettings",
    "JumpSettings",
    "LegStrokes",
    "LeggedSettings",
    "LeggedWeights",
    "Multirotor",
    "MultirotorSettings",
    "ReachSettings",
    "ReachWeights",
    "RightingSettings",
    "RightingWeights",
    "Scenario",
    "StandingReachSettings",
    "StandingReachWeights",
    "Waypoint",
    "build_flight",
    "build_free_jump",
    "build_gait",
    "build_jump",
    "build_legged",
    "build_reach",
    "build_righting",
    "build_standing_reach",
]


def _builders() -> Mapping[type[ProblemSettings], Callable[[Robot, Any], Scenario]]:
    return {
        FlightSettings: build_flight,
        FreeJumpSettings: build_free_jump,
        GaitSettings: build_gait,
        JumpSettings: build_jump,
        ReachSettings: build_reach,
        RightingSettings: build_righting,
        StandingReachSettings: build_standing_reach,
    }


if TYPE_CHECKING:
    AnyProblemSettings = ProblemSettings
else:
    AnyProblemSettings = Annotated[Union[tuple(_builders())], Field(discriminator="kind")]  # noqa: UP007
    """The settings of one kind of problem, selected by the key ``kind``."""


@typed
def build_problem(robot: Robot, settings: ProblemSettings) -> Scenario:
    """Return the problem that ``settings`` describe.

    Raises:
        InputError: for a key of ``settings``, or for ``robot``, that this problem cannot use.
    """
    kinds = _builders()
    build = kinds.get(type(settings))
    if build is None:
        names = tuple(kind.__name__ for kind in kinds)
        raise InputError("settings", type(settings).__name__, "settings of one kind of problem", names)
    return build(robot, settings)
