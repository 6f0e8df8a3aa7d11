"""Scenarios from configs: errors of builders have the key and place of the config."""

from __future__ import annotations

from pathlib import Path

import pytest

from lgmpc.config import load_solve_config
from lgmpc.config.solving import build_scenario
from lgmpc.errors import ConfigError

CONFIGS = Path(__file__).resolve().parents[2] / "configs"


@pytest.mark.parametrize(
    ("config", "change", "message"),
    [
        ("iris_loop", "problem.rotors.max_thrust_n=3.0", "--set: problem.rotors.max_thrust_n: got 3.0; expected above"),
        ("iris_loop", "problem.rotors.frames.0=iris__rotor_9", "--set: problem.rotors.frames.0: got iris__rotor_9"),
        ("iris_loop", "problem.node_s=0.031", "problem.waypoints: got 'entry"),
        ("solo12_righting", "problem.strokes.ramp_s=9.0", "--set: problem.strokes.ramp_s: got 9.0; expected above 0"),
        ("solo12_righting", "problem.strokes.sweep_rad={x: 1}", "--set: problem.strokes.sweep_rad: got x; expected"),
        ("solo12_trot", "problem.ramp_s=9.0", "--set: problem.ramp_s: got 9.0; expected at most"),
        ("solo12_trot", "robot.contact_frames=[FL_FOOT]", "robot.contact_frames: got FL_FOOT; expected four"),
        ("panda_reach", "problem.frame=hand", "--set: problem.frame: got hand; expected a frame of panda"),
        ("panda_reach", "robot.floating_base=true", "robot: got panda, whose base is free"),
    ],
)
def test_errors_of_builders_have_key_and_place(config: str, change: str, message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        build_scenario(load_solve_config(CONFIGS / f"{config}.yaml", [change]))
    assert message in str(caught.value)
