"""The distance of a run's capture point from the edge of the support."""

from dataclasses import replace

import numpy as np
import pytest

from lgmpc.runs.limited import capture_margin
from lgmpc.runs.log import MODES


def test_the_capture_point_leads_by_the_pendulums_time_constant(changed) -> None:
    def edit(arrays: dict[str, np.ndarray]) -> None:
        arrays["momentum"][:, 0] = 2.5 * 0.7
        arrays["com"][:, 2] = 0.981  # sqrt(z / g) = sqrt(0.1) s

    log = replace(changed(edit), mass_kg=2.5)
    assert capture_margin(log)[0] == pytest.approx(0.2 - 0.7 * np.sqrt(0.1))


def test_a_body_that_may_lie_on_the_floor_has_no_capture_point(changed) -> None:
    log = replace(changed(lambda arrays: None), mass_kg=2.5)
    mode = np.full(log.ticks, MODES.index("stand"), dtype=np.int8)
    mode[500:] = MODES.index("sit")
    steps = {
        "command": np.zeros((log.ticks, 3)),
        "gait_period_s": np.full(log.ticks, 0.4),
        "stance": np.ones((log.ticks, 4), dtype=np.int8),
        "contact_states": np.zeros((log.ticks, 4), dtype=np.int8),
        "swing_targets": np.zeros((log.ticks, 4, 3)),
        "footholds": np.zeros((log.ticks, 4, 3)),
    }
    margin = capture_margin(replace(log, mode=mode, **steps))
    assert np.isfinite(margin[:500]).all() and np.isnan(margin[500:]).all()
