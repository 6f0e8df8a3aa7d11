"""Ready-made optimal control problems.

A builder takes a robot and settings, and returns a :class:`Scenario`: the shooting problem, an initial guess, and the
figures of merit of a solution.

    scenario = build_gait(robot, GaitSettings(pattern="walk", cycles=2))
    solution = BoxFddp(scenario.problem).solve(scenario.guess)
    print(scenario.figures(solution.trajectory))

Other gaits are sequences of phases (:class:`~lgmpc.locomotion.sequence.GaitSequence`); :func:`build_legged` combines
any of them with any motion of the base. ``reactions`` and ``soles`` compute forces and margins of any trajectory by
Pinocchio.
"""

from lgmpc.locomotion.sequence import GaitPhase
from lgmpc.problems.com_circle import ComCircleSettings, ComCircleWeights, build_com_circle
from lgmpc.problems.flight import FlightSettings, FlightWaypoint, FlightWeights, build_flight
from lgmpc.problems.footsteps import BaseLeap, BaseMotion, BasePath, Footsteps
from lgmpc.problems.free_jump import FreeJumpSettings, build_free_jump
from lgmpc.problems.kinds import AnyProblemSettings, build_problem
from lgmpc.problems.leg_strokes import LegStrokes
from lgmpc.problems.legged import build_gait, build_jump, build_legged
from lgmpc.problems.legged_settings import GaitSettings, JumpSettings, JumpWeights, LeggedSettings, LeggedWeights
from lgmpc.problems.multirotor import Multirotor, MultirotorSettings
from lgmpc.problems.reach import ReachSettings, ReachWeights, build_reach
from lgmpc.problems.recovery import RecoverySettings, RecoveryWeights, build_recovery
from lgmpc.problems.righting import RightingSettings, RightingWeights, build_righting
from lgmpc.problems.scenario import Controls, ProblemSettings, Scenario, Waypoint
from lgmpc.problems.standing_reach import StandingReachSettings, StandingReachWeights, build_standing_reach

__all__ = [
    "AnyProblemSettings",
    "JumpWeights",
    "ProblemSettings",
    "build_problem",
    "BaseLeap",
    "BaseMotion",
    "BasePath",
    "ComCircleSettings",
    "ComCircleWeights",
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
    "RecoverySettings",
    "RecoveryWeights",
    "RightingSettings",
    "RightingWeights",
    "Scenario",
    "StandingReachSettings",
    "StandingReachWeights",
    "Waypoint",
    "build_com_circle",
    "build_flight",
    "build_free_jump",
    "build_gait",
    "build_jump",
    "build_legged",
    "build_reach",
    "build_recovery",
    "build_righting",
    "build_standing_reach",
]
