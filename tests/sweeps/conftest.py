"""A sweep of a robot that stands for a tenth of a second."""

from collections.abc import Callable
from pathlib import Path

import pytest

from lgmpc.sweeps import Row, Sweep, parse_sweep

ROOT = Path(__file__).resolve().parents[2]

STAND = """
name: stand
base: solo12_stand
set: {duration_s: 0.1, mpc.enabled: false}
gate: {max_tilt_deg: 5.0}
"""

Parse = Callable[..., Sweep]


@pytest.fixture
def parse() -> Parse:
    """Check the document of a sweep of a standing robot, with what is added to it."""

    def run(text: str, *overrides: str) -> Sweep:
        return parse_sweep(STAND + text, overrides=overrides)

    return run


@pytest.fixture
def row() -> Callable[..., Row]:
    """Make a row of a key; other fields by name."""
    from lgmpc.sweeps import Ending

    def make(key: str, ending: Ending = Ending.PASS, **fields: object) -> Row:
        return Row(key, ending, **fields)  # type: ignore[arg-type]

    return make
