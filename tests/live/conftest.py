"""A config to drive, and a run whose wishes come from the test."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from snapshot import headless_chromium

from lgmpc.config import Config, load_config


@pytest.fixture(scope="session")
def config() -> Config:
    return load_config("solo12_velocity", ["commands=[]", "after_fall_s=null", "duration_s=2.0"])


@pytest.fixture(scope="module")  # a second one cannot be started while it runs
def browser() -> Iterator[Any]:
    with headless_chromium() as browser:
        yield browser
