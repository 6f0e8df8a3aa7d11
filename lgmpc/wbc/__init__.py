"""Whole-body control: tasks, one QP over accelerations and contact forces, ProxQP, torques."""

from lgmpc.wbc.assembly import QpAssembly, WholeBodyLimits
from lgmpc.wbc.controller import WholeBodyController, WholeBodySettings, standing_tasks
from lgmpc.wbc.reference import WholeBodyReference
from lgmpc.wbc.solver import QpStatus, WholeBodySolver
from lgmpc.wbc.tasks import Gain, Task, TaskStack
from lgmpc.wbc.terms import WholeBodyTerms

__all__ = [
    "Gain",
    "QpAssembly",
    "QpStatus",
    "Task",
    "TaskStack",
    "WholeBodyController",
    "WholeBodyLimits",
    "WholeBodyReference",
    "WholeBodySettings",
    "WholeBodySolver",
    "WholeBodyTerms",
    "standing_tasks",
]
