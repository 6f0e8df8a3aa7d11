"""Tolerances and schedules of feasibility-driven differential dynamic programming."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from lgmpc.settings import NonNegative, Positive, problem
from lgmpc.solvers.loop import SolverSettings

__all__ = ["FddpSettings"]

_StepLength = Annotated[float, Field(strict=True, gt=0.0, le=1.0, allow_inf_nan=False)]


class FddpSettings(SolverSettings):
    """Tolerances and schedules of FDDP and box FDDP; the defaults are Crocoddyl's.

    A feasible trajectory is a solution when two measures are small. The expected reduction of the cost by a full step
    is independent of the scaling of states and controls, but insensitive to directions in which the cost hardly varies.
    The Lagrangian's gradient is relative to the multipliers, as in SNOPT (Gill, Murray, Saunders, SIAM Review 47,
    2005), since it is a difference of them.
    """

    method: Literal["fddp", "box_fddp"] = Field(
        default="fddp", description="fddp: no constraints; box_fddp: bounds on controls."
    )
    tolerance: Positive = Field(default=1e-9, description="Largest expected reduction of the cost of a solution.")
    stationarity: Annotated[float, Field(strict=True, gt=0.0, allow_inf_nan=True)] = Field(
        default=1e-6,
        description="Largest entry of the Lagrangian's gradient of a solution, per 1 + the largest multiplier; "
        ".inf: of any size, as in Crocoddyl.",
    )
    step_lengths: Annotated[tuple[_StepLength, ...], Field(min_length=1)] = Field(
        default=tuple(2.0**-i for i in range(10)), description="Step lengths, tried in this order."
    )
    acceptance: NonNegative = Field(
        default=0.1, description="Least fraction of the expected reduction of the cost of an accepted step."
    )
    regularization: tuple[Positive, Positive] = Field(
        default=(1e-9, 1e9), description="[lowest, highest] regularisation."
    )
    initial_regularization: Positive | None = Field(
        default=None, description="Regularisation that a solve starts from. null: the lowest."
    )

    @model_validator(mode="after")
    def _regularization_is_ordered(self) -> FddpSettings:
        if self.regularization[0] > self.regularization[1]:
            raise problem(
                "[lowest, highest] with lowest not above highest", "regularization", list(self.regularization)
            )
        lowest, highest = self.regularization
        start = self.initial_regularization
        if start is not None and not lowest <= start <= highest:
            raise problem(f"a number between {lowest:g} and {highest:g}", "initial_regularization", start)
        return self
