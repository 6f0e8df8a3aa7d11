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
from lgmpc.problems.flight import (
    FlightSettings as FlightSettings,
    Multirotor as Multirotor,
    MultirotorSettings as MultirotorSettings,
    build_flight as build_flight,
)
from lgmpc.problems.footsteps import BasePath as BasePath, Footsteps as Footsteps
from lgmpc.problems.free_jump import FreeJumpSettings as FreeJumpSettings, build_free_jump as build_free_jump
from lgmpc.problems.legged import build_gait as build_gait, build_jump as build_jump, build_legged as build_legged
from lgmpc.problems.legged_settings import (
    GaitSettings as GaitSettings,
    JumpSettings as JumpSettings,
    LeggedSettings as LeggedSettings,
)
from lgmpc.problems.reach import ReachSettings as ReachSettings, build_reach as build_reach
from lgmpc.problems.righting import (
    LegStrokes as LegStrokes,
    RightingSettings as RightingSettings,
    build_righting as build_righting,
)
from lgmpc.problems.scenario import ProblemSettings as ProblemSettings, Scenario as Scenario
from lgmpc.problems.standing_reach import (
    StandingReachSettings as StandingReachSettings,
    build_standing_reach as build_standing_reach,
)
from lgmpc.robot import Robot
from lgmpc.typing import typed


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
