"""Notes on valid configs."""

import pytest

from lgmpc.cli.inspecting import notes_on
from lgmpc.config import parse_config


def test_a_plain_config_has_no_notes(small: str) -> None:
    assert notes_on(parse_config(small)) == ()


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("duration_s=1", "pushes.0 begins at 2 s, after the end of the run (1 s)"),
        ("duration_s=2.1", "pushes.0 is cut short"),
        ("gate.steady_from_s=20", "gate.steady_from_s is after the end"),
        ("wbc.friction=0.7", "wbc.friction (0.7) is above the floor's (0.6)"),
        ("sensors.gyro_bias_rad_s=0.1", "sensors: not used"),
        ("mpc.friction=0.7", "mpc.friction (0.7) is above the floor's (0.6)"),
    ],
)
def test_probable_mistakes_are_noted(small: str, override: str, words: str) -> None:
    (note,) = notes_on(parse_config(small, overrides=[override]))
    assert words in note


def test_an_mpc_that_is_off_needs_no_note(small: str) -> None:
    assert notes_on(parse_config(small, overrides=["mpc.friction=0.7", "mpc.enabled=false"])) == ()
