"""When prediction and measurement agree."""

from __future__ import annotations

import math

import pytest

from lgmpc.demos import load_demo
from lgmpc.demos.outcome import Outcome, Row
from lgmpc.errors import InputError


def test_a_row_agrees_within_its_tolerance() -> None:
    assert Row("x", 1.0, 1.1, 0.2).agrees
    assert not Row("x", 1.0, 1.3, 0.2).agrees


@pytest.mark.parametrize("measured", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_agrees_with_nothing(measured: float) -> None:
    assert not Row("x", 1.0, measured, math.inf).agrees
    assert not Outcome((Row("y", 0.0, 0.0, 0.0), Row("x", 1.0, measured, 1.0))).agrees


def test_an_unknown_demonstration_is_refused() -> None:
    with pytest.raises(InputError, match="a demonstration"):
        load_demo("dzhanibekof")
