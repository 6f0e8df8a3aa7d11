"""The kinds of problems of configs.

A new kind is one file, with its settings (``kind: Literal["<kind>"]`` among them) and a function that builds a
:class:`~lgmpc.problems.Scenario` from a robot and these settings, and one line below. ``lgmpc schema --out
configs/schema.json`` then writes the schema for editors.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Annotated, Any, Union

from pydantic import Field

from lgmpc.errors import InputError
from lgmpc.lie.checks import typed
from lgmpc.problems.com_circle import ComCircleSettings, build_com_circle
from lgmpc.problems.flight import FlightSettings, build_flight
from lgmpc.problems.free_jump import FreeJumpSettings, build_free_jump
from lgmpc.problems.legged import build_gait, build_jump
from lgmpc.problems.legged_settings import GaitSettings, JumpSettings
from lgmpc.problems.reach import ReachSettings, build_reach
from lgmpc.problems.recovery import RecoverySettings, build_recovery
from lgmpc.problems.righting import RightingSettings, build_righting
from lgmpc.problems.scenario import ProblemSettings, Scenario
from lgmpc.problems.standing_reach import StandingReachSettings, build_standing_reach
from lgmpc.robot import Robot

__all__ = ["AnyProblemSettings", "build_problem"]


def _builders() -> Mapping[type[ProblemSettings], Callable[[Robot, Any], Scenario]]:
    return {
        ComCircleSettings: build_com_circle,
        FlightSettings: build_flight,
        FreeJumpSettings: build_free_jump,
        GaitSettings: build_gait,
        JumpSettings: build_jump,
        ReachSettings: build_reach,
        RecoverySettings: build_recovery,
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
