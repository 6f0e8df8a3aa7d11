"""What every section of a config shares: its strictness, its number types, and errors that point at a key."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Union

from pydantic import BaseModel, BeforeValidator, ConfigDict, Discriminator, Field, Tag
from pydantic_core import PydanticCustomError

__all__ = [
    "LARGEST",
    "PROBLEM",
    "Count",
    "Finite",
    "Fraction",
    "NonNegative",
    "PerJoint",
    "PerJointPositive",
    "PerJointRange",
    "Positive",
    "Problem",
    "Range",
    "RangeFromZero",
    "Section",
    "Vector2",
    "Vector3",
    "problem",
    "problems",
]

PROBLEM = "lgmpc"
"""The pydantic error type of everything that :func:`problems` makes."""


class Section(BaseModel):
    """A part of a config: unknown keys are errors, values cannot be changed after they were checked."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, hide_input_in_errors=True)


@dataclass(frozen=True)
class Problem:
    """What is wrong with one key.

    Attributes:
        key: dotted path below the validated section; empty for the validated value itself.
        got: the value of that key; not used where ``key`` is empty.
        expected: what would have been accepted, in words.
    """

    key: str
    got: Any
    expected: str


def problems(found: Sequence[Problem]) -> PydanticCustomError:
    """Make the error by which a validator reports all that it found."""
    return PydanticCustomError(PROBLEM, "cannot be used", {"problems": tuple(found)})


def problem(expected: str, key: str = "", got: Any = None) -> PydanticCustomError:
    """Make the error by which a validator reports one problem; arguments as in :class:`Problem`."""
    return problems([Problem(key, got, expected)])


LARGEST = 1e9
"""No number of a config is larger: beyond it there is no robot, only overflow."""

Finite = Annotated[float, Field(strict=True, ge=-LARGEST, le=LARGEST, allow_inf_nan=False)]
"""A finite number."""
Positive = Annotated[float, Field(strict=True, gt=0.0, le=LARGEST, allow_inf_nan=False)]
"""A finite number above zero."""
NonNegative = Annotated[float, Field(strict=True, ge=0.0, le=LARGEST, allow_inf_nan=False)]
"""A finite number, zero or above."""
Fraction = Annotated[float, Field(strict=True, ge=0.0, le=1.0, allow_inf_nan=False)]
"""A number from 0 to 1."""
Count = Annotated[int, Field(strict=True, ge=1, le=10_000)]
"""A whole number from 1 to 10000."""


def _need_list(length: int, words: str) -> BeforeValidator:
    def check(value: Any) -> Any:
        if not isinstance(value, (list, tuple)) or len(value) != length:
            raise problem(f"a list of {words}")
        return value

    return BeforeValidator(check)


def _check_order(value: Any) -> Any:
    if all(isinstance(v, (int, float)) for v in value) and value[0] >= value[1]:
        raise problem("[lowest, highest] with lowest below highest")
    return value


Vector2 = Annotated[tuple[Finite, Finite], _need_list(2, "two numbers [x, y]")]
"""Two finite numbers."""
Vector3 = Annotated[tuple[Finite, Finite, Finite], _need_list(3, "three numbers [x, y, z]")]
"""Three finite numbers, world axes."""
Range = Annotated[tuple[Finite, Finite], BeforeValidator(_check_order), _need_list(2, "two numbers [lowest, highest]")]
"""Two finite numbers, the lower one first."""
RangeFromZero = Annotated[
    tuple[NonNegative, Positive], BeforeValidator(_check_order), _need_list(2, "two numbers [lowest, highest]")
]
"""Two numbers, zero or above, the lower one first."""


def _number_or_table(value: Any) -> str:
    return "table" if isinstance(value, Mapping) else "number"


def _range_or_table(value: Any) -> str:
    return "table" if isinstance(value, Mapping) else "range"


PerJoint = Annotated[
    Union[Annotated[NonNegative, Tag("number")], Annotated[dict[str, NonNegative], Tag("table")]],  # noqa: UP007
    Discriminator(_number_or_table),
]
"""One number, zero or above, for all joints, or ``{joint name or pattern: number}``."""
PerJointPositive = Annotated[
    Union[Annotated[Positive, Tag("number")], Annotated[dict[str, Positive], Tag("table")]],  # noqa: UP007
    Discriminator(_number_or_table),
]
"""One number above zero for all joints, or ``{joint name or pattern: number}``."""
PerJointRange = Annotated[
    Union[Annotated[Range, Tag("range")], Annotated[dict[str, Range], Tag("table")]],  # noqa: UP007
    Discriminator(_range_or_table),
]
"""One ``[lowest, highest]`` for all joints, or ``{joint name or pattern: [lowest, highest]}``."""
