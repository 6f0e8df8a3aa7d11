"""Config section ``solver``: which solver, and when it stops."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from lgmpc.settings import Positive, Settings, problem

__all__ = ["SolverSection"]


class SolverSection(Settings):
    """The solver of the optimal control problem."""

    method: Literal["fddp", "box_fddp", "sqp", "ipopt", "fatrop"] = Field(
        default="fddp",
        description="fddp: no constraints; box_fddp: bounds on controls; sqp, ipopt, fatrop: any constraints.",
    )
    max_iterations: Annotated[int, Field(strict=True, ge=0, le=100_000)] = Field(
        default=200, description="Most iterations."
    )
    tolerance: Positive | None = Field(
        default=None,
        description="Solved when below: for fddp and box_fddp the cost that is left to gain, for the others the "
        "residual of the optimality conditions. null: 1e-9, 1e-6 (sqp), 1e-8 (ipopt, fatrop).",
    )
    time_limit_s: Positive | None = Field(
        default=None, description="Stop after this time, s (compiling does not count). null: never."
    )

    @model_validator(mode="after")
    def _fatrop_has_no_clock(self) -> SolverSection:
        if self.method == "fatrop" and self.time_limit_s is not None:
            raise problem("null: fatrop cannot be interrupted", key="time_limit_s", got=self.time_limit_s)
        return self
