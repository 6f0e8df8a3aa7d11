"""Whole-body control: tasks, one QP over accelerations and contact forces, ProxQP, torques."""

from lgmpc.wbc.assembly import Contacts as Contacts
from lgmpc.wbc.controller import WholeBodyController as WholeBodyController
from lgmpc.wbc.hands import HandMotion as HandMotion, HandTask as HandTask
from lgmpc.wbc.library import standard_tasks as standard_tasks
from lgmpc.wbc.settings import Gain as Gain, WholeBodySettings as WholeBodySettings
from lgmpc.wbc.solver import WholeBodySolver as WholeBodySolver
from lgmpc.wbc.tasks import NumericTask as NumericTask, SymbolicTask as SymbolicTask, Task as Task
from lgmpc.wbc.terms import WholeBodyTerms as WholeBodyTerms
