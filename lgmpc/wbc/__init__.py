"""Whole-body control: tasks, one QP over accelerations and contact forces, ProxQP, torques."""

from lgmpc.wbc.assembly import Contacts, WholeBodyQp
from lgmpc.wbc.controller import WholeBodyController
from lgmpc.wbc.hands import HandMotion, HandTask
from lgmpc.wbc.library import standard_tasks
from lgmpc.wbc.settings import Gain, WholeBodySettings
from lgmpc.wbc.solver import WholeBodySolver
from lgmpc.wbc.tasks import NumericTask, SymbolicTask, Task
from lgmpc.wbc.terms import WholeBodyTerms

__all__ = [
    "Contacts",
    "Gain",
    "HandMotion",
    "HandTask",
    "NumericTask",
    "SymbolicTask",
    "Task",
    "WholeBodyController",
    "WholeBodyQp",
    "WholeBodySettings",
    "WholeBodySolver",
    "WholeBodyTerms",
    "standard_tasks",
]
