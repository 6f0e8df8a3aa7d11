"""Controllers made of the other rooms' parts: what a robot is asked to do, and how it keeps its balance meanwhile."""

from lgmpc.control.balance import BalanceController
from lgmpc.control.planner import Planner, PlannerSettings
from lgmpc.control.prediction import CentroidalPredictor, Predictor, WholeBodyPredictor
from lgmpc.control.reference import CircleReference, ComReference, StandReference

__all__ = [
    "BalanceController",
    "CentroidalPredictor",
    "CircleReference",
    "ComReference",
    "Planner",
    "PlannerSettings",
    "Predictor",
    "StandReference",
    "WholeBodyPredictor",
]
