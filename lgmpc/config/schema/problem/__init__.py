"""Config section ``problem``: what is optimised. One module a kind; :mod:`lgmpc.config.scenarios` builds them."""

from typing import Annotated, Union

from pydantic import Field

from lgmpc.config.schema.problem.com_circle import ComCircleProblem
from lgmpc.config.schema.problem.flight import FlightProblem
from lgmpc.config.schema.problem.legged import GaitProblem, JumpProblem
from lgmpc.config.schema.problem.reach import ReachProblem
from lgmpc.config.schema.problem.recovery import RecoveryProblem
from lgmpc.config.schema.problem.righting import RightingProblem
from lgmpc.config.schema.problem.standing_reach import StandingReachProblem

__all__ = [
    "ComCircleProblem",
    "FlightProblem",
    "GaitProblem",
    "JumpProblem",
    "ProblemSection",
    "ReachProblem",
    "RecoveryProblem",
    "RightingProblem",
    "StandingReachProblem",
]

ProblemSection = Annotated[
    Union[  # noqa: UP007 (evaluated at run time)
        ComCircleProblem,
        FlightProblem,
        GaitProblem,
        JumpProblem,
        ReachProblem,
        RecoveryProblem,
        RightingProblem,
        StandingReachProblem,
    ],
    Field(discriminator="kind"),
]
"""One kind of problem, chosen by the key ``kind``."""
