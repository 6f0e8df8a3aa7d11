"""Config section ``gate`` of a problem to solve: what counts as success."""

from __future__ import annotations

from typing import Any

from pydantic import ConfigDict, Field, model_validator

from lgmpc.runs.figures import figure_of, is_signed
from lgmpc.settings import LARGEST, Finite, Problem, Settings, problems

__all__ = ["SolveGateSection"]


class SolveGateSection(Settings):
    """Bounds on the figures of a solution: ``max_<figure>`` and ``min_<figure>``.

    Which figures there are depends on the problem; an unknown one is an error that names the nearest.
    """

    model_config = ConfigDict(
        extra="allow",
        json_schema_extra={
            "additionalProperties": False,
            "patternProperties": {
                "^(max|min)_[a-z0-9_]+$": {
                    "type": "number",
                    "description": "Bound on a figure of the solution; `lgmpc check` lists the figures.",
                }
            },
        },
    )
    __pydantic_extra__: dict[str, Finite] = Field(init=False)

    converged: bool = Field(
        default=True, strict=True, description="true: the solver has to reach its tolerance. false: it need not."
    )

    @model_validator(mode="before")
    @classmethod
    def _bounds(cls, data: Any) -> Any:
        """Refuse all wrong names and all wrong numbers together."""
        if not isinstance(data, dict):
            return data
        wrong = []
        for key, value in data.items():
            if key == "converged":
                continue
            if not key.startswith(("max_", "min_")):
                wrong.append(Problem(key, value, "the key converged, or a bound: max_<figure> or min_<figure>"))
            elif isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= LARGEST:
                wrong.append(Problem(key, value, "a finite number"))
            elif value < 0 and not is_signed(figure_of(key)):
                wrong.append(Problem(key, value, f"a number not below 0: {figure_of(key)} cannot be negative"))
        if wrong:
            raise problems(wrong)
        return data

    @property
    def bounds(self) -> dict[str, float]:
        """The bounds, by their keys (``max_effort_ratio``)."""
        return dict(self.__pydantic_extra__ or {})
