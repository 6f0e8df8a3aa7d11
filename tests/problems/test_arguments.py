"""Arguments of other types are named by one error."""

from __future__ import annotations

import inspect
import math

import numpy as np
import pytest
from samples import solo

import lgmpc.problems as problems
from lgmpc.errors import InputError
from lgmpc.problems import ProblemSettings, build_problem

BUILDERS = [getattr(problems, name) for name in dir(problems) if name.startswith("build_")]


class _Own(ProblemSettings):
    """Settings that no builder takes."""

    kind: str = "own"


@pytest.mark.parametrize("bad", [None, "text", math.nan, np.zeros(3), [], {}], ids=lambda bad: type(bad).__name__)
@pytest.mark.parametrize("build", BUILDERS, ids=lambda build: build.__name__)
def test_robot_and_settings_of_other_types_are_named(build, bad) -> None:
    names = [name for name in inspect.signature(build).parameters if name != "settings"]
    first = "name" if names[0] == "name" and not isinstance(bad, str) else "robot"
    with pytest.raises(InputError, match=f"^{first}: got "):
        build(*[bad] * len(inspect.signature(build).parameters))


def test_settings_of_no_kind_are_named() -> None:
    with pytest.raises(InputError, match="settings: got _Own"):
        build_problem(solo(), _Own())
