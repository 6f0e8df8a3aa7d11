"""Controllers made of the other rooms' parts: what a robot is asked to do, and how it keeps its balance meanwhile."""

from lgmpc.control.balance import BalanceController
from lgmpc.control.planner import CentroidalPlanner, PlannerSettings
from lgmpc.control.reference import CircleReference, ComReference, StandReference

__all__ = [
    "BalanceController",
    "CentroidalPlanner",
    "CircleReference",
    "ComReference",
    "PlannerSettings",
    "StandReference",
]
