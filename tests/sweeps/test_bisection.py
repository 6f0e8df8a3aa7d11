"""The search of a boundary."""

import pytest

from lgmpc.config import load_config
from lgmpc.errors import InputError
from lgmpc.sweeps.design import scaled
from lgmpc.sweeps.settings import BisectionSettings
from lgmpc.sweeps.trial import bisect


def settings(**changes: object) -> BisectionSettings:
    return BisectionSettings(**{"key": "plant.friction", "range": (0.5, 8.0), "tolerance": 0.01, **changes})


def test_the_boundary_is_found_from_below_to_the_tolerance() -> None:
    found = bisect(lambda x: x <= 3.2, settings())
    assert found.value is not None
    assert 3.2 - 0.01 <= found.value <= 3.2
    assert len(found.trials) == 2 + 10  # both ends, and ten halvings of 7.5
    assert all(passed == (value <= 3.2) for value, passed in found.trials)
    exact = bisect(lambda x: x <= 3.2, settings(range=(0.0, 8.0), tolerance=1.0))
    assert (exact.value, len(exact.trials)) == (3.0, 2 + 3)  # an interval as wide as the tolerance is the last


@pytest.mark.parametrize(
    ("edge", "words"), [(0.1, "0.5, where the run fails already"), (9.0, "8, where the run still")]
)
def test_ends_that_agree_give_no_boundary_but_a_remedy(edge: float, words: str) -> None:
    found = bisect(lambda x: x <= edge, settings())
    assert found.value is None
    assert found.reason.startswith("bisect.range: got ")
    assert words in found.reason


def test_a_tolerance_below_the_resolution_of_numbers_ends_the_search() -> None:
    found = bisect(lambda x: x <= 7e8, settings(range=(0.0, 1e9), tolerance=1e-9))
    assert found.value == 7e8
    assert len(found.trials) < 100


def test_a_value_scales_a_vector_and_replaces_a_number() -> None:
    config = load_config("solo12_balance")
    assert scaled(config, "pushes.0.impulse_ns", 2.0).pushes[0].impulse_ns == (0.0, 4.0, 0.0)
    assert scaled(config, "plant.friction", 2.0).plant.friction == 2.0
    with pytest.raises(InputError, match="Did you mean plant.friction"):
        scaled(config, "plant.frict", 2.0)
