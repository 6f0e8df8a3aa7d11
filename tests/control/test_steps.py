"""Steps of a standing robot against pushes, in closed loop."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lgmpc.config.build import prepare
from lgmpc.config.closed_loop import ClosedLoopSession
from lgmpc.config.loading import load_config
from lgmpc.errors import ConfigError

CONFIG = Path(__file__).parents[2] / "configs" / "solo12_step.yaml"


def pushed(impulse: float, *overrides: str, seconds: float = 3.0) -> tuple[ClosedLoopSession, bool, float]:
    """Return the session, whether the robot is up, and how far the feet moved."""
    push = f"pushes=[{{body: base_link, time_s: 0.3, duration_s: 0.2, impulse_ns: [0.0, {impulse}, 0.0]}}]"
    session = prepare(load_config(CONFIG, [push, f"duration_s={seconds}", *overrides]))
    assert isinstance(session, ClosedLoopSession)
    metrics = session.run(lambda progress: None).metrics
    assert metrics is not None
    return session, not metrics.fell, metrics.max_foot_displacement_m


def test_a_push_that_the_feet_can_hold_is_held_in_place() -> None:
    session, up, moved = pushed(2.0, seconds=1.2)
    assert up and moved < 0.005
    assert session.controller.feet.standing


@pytest.mark.slow
def test_a_harder_push_is_met_by_steps_and_ends_in_standing() -> None:
    session, up, moved = pushed(5.0)
    assert up and moved > 0.1
    assert session.controller.feet.standing
    assert np.abs(session.recorder.log().v[-1]).max() < 0.05
    _, up_without, _ = pushed(5.0, "locomotion.reaction.enabled=false")
    assert not up_without


def test_steps_with_an_unknown_gait_are_refused_before_the_run() -> None:
    with pytest.raises(ConfigError, match=r"locomotion.reaction.gait: got 'trott'; .* Did you mean trot"):
        prepare(load_config(CONFIG, ["locomotion.reaction.gait=trott"]))
