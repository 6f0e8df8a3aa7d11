"""The config of a trajectory to optimise."""

from __future__ import annotations

from pydantic import Field

from lgmpc.config.schema.document import Document
from lgmpc.config.schema.problem import ProblemSection
from lgmpc.config.schema.solve_gate import SolveGateSection
from lgmpc.config.schema.solver import SolverSection

__all__ = ["SolveConfig"]


class SolveConfig(Document):
    """A trajectory to optimise: a robot, a problem, a solver, and what counts as success."""

    problem: ProblemSection = Field(description="What is optimised.")
    solver: SolverSection = Field(default=SolverSection(), description="How it is solved.")
    gate: SolveGateSection = Field(default=SolveGateSection(), description="What counts as success.")
