"""The first difference between two logs: found wherever one bit is changed, and named."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from lgmpc.runs import RunLog
from lgmpc.runs.difference import first_difference

Change = Callable[[Callable[[dict[str, np.ndarray]], None]], RunLog]


def test_a_log_does_not_differ_from_itself_nor_by_its_durations(standing: RunLog, changed: Change) -> None:
    def slower(arrays: dict[str, np.ndarray]) -> None:
        arrays["wbc_ms"] += 1.0
        arrays["mpc_ms"] += 1.0

    assert first_difference(standing, standing) is None
    assert first_difference(standing, changed(slower)) is None


@pytest.mark.parametrize(
    ("channel", "at", "name", "time"),
    [("q", (412, 7), "q[7]", 0.412), ("contact_forces", (3, 1, 2), "contact_forces[1][2]", 0.003)],
)
def test_one_bit_is_found(
    standing: RunLog, changed: Change, channel: str, at: tuple[int, ...], name: str, time: float
) -> None:
    def disturbed(arrays: dict[str, np.ndarray]) -> None:
        arrays[channel][at] = np.nextafter(arrays[channel][at], np.inf)

    found = first_difference(standing, changed(disturbed))
    assert found is not None
    assert (found.tick, found.channel) == (at[0], name) and found.time_s == pytest.approx(time)
    assert found.second == np.nextafter(found.first, np.inf)
    assert first_difference(standing, changed(disturbed), until_s=time) is None


def test_the_earliest_of_several_differences_is_reported(standing: RunLog, changed: Change) -> None:
    def disturbed(arrays: dict[str, np.ndarray]) -> None:
        arrays["q"][500, 0] = 1.0
        arrays["mpc_forces"][20, 3, 1] = 1.0  # the update at 0.2 s
        arrays["tau"][300, 2] = 1.0

    found = first_difference(standing, changed(disturbed))
    assert found is not None and found.channel == "mpc_forces[3][1]" and found.tick == 20


def test_signs_of_zeros_differ_and_nan_equals_itself(standing: RunLog, changed: Change) -> None:
    def negative(arrays: dict[str, np.ndarray]) -> None:
        arrays["momentum"][10, 0] = -0.0

    def undefined(arrays: dict[str, np.ndarray]) -> None:
        arrays["momentum"][10, 0] = np.nan

    found = first_difference(standing, changed(negative))
    assert found is not None and found.channel == "momentum[0]"
    assert first_difference(changed(undefined), changed(undefined)) is None


def test_nothing_is_compared_before_the_first_tick(standing: RunLog, changed: Change) -> None:
    def failed(arrays: dict[str, np.ndarray]) -> None:
        arrays["wbc_status"][5] = 1

    assert first_difference(standing, changed(failed), until_s=0.0) is None


def test_a_log_that_ends_early_differs_at_its_end(standing: RunLog) -> None:
    for first, second in ((standing, standing.until(700)), (standing.until(700), standing)):
        found = first_difference(first, second)
        assert found is not None and found.channel == "time" and found.tick == 700
        assert np.isnan(found.second) == (first is standing)
        assert first_difference(first, second, until_s=0.7) is None
