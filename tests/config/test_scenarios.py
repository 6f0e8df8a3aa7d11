"""Sections ``problem``: what they say in the words of ``lgmpc.problems``, and that their defaults are the library's."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import TypeAdapter

from lgmpc.config.scenarios import problem_settings
from lgmpc.config.schema.problem import ProblemSection
from lgmpc.problems import (
    ComCircleSettings,
    FlightSettings,
    FlightWaypoint,
    GaitPhase,
    GaitSettings,
    JumpSettings,
    LegStrokes,
    MultirotorSettings,
    ReachSettings,
    RecoverySettings,
    RightingSettings,
    StandingReachSettings,
)

ROTORS = {"frames": ["a", "b"], "turning": ["ccw", "cw"], "max_thrust_n": 2.0}
PAIR = MultirotorSettings(("a", "b"), ("ccw", "cw"), 2.0)
PLACE = (0.1, 0.2, 0.3)
STROKES = {"stretched_rad": {"knee": 0.0}, "folded_rad": {"knee": 2.0}, "sweep_rad": {"hip": 1.0}}
LEAST: list[tuple[dict[str, Any], Any]] = [
    ({"kind": "com_circle"}, ComCircleSettings()),
    ({"kind": "gait", "pattern": "trot"}, GaitSettings()),
    ({"kind": "jump"}, JumpSettings()),
    ({"kind": "reach", "frame": "hand", "position_m": PLACE}, ReachSettings("hand", PLACE)),
    ({"kind": "standing_reach", "frame": "hand", "position_m": PLACE}, StandingReachSettings("hand", PLACE)),
    ({"kind": "recovery", "rotors": ROTORS}, RecoverySettings(PAIR)),
    (
        {"kind": "righting", "strokes": STROKES},
        RightingSettings(LegStrokes({"knee": 0.0}, {"knee": 2.0}, {"hip": 1.0})),
    ),
    (
        {
            "kind": "flight",
            "rotors": ROTORS,
            "start_m": PLACE,
            "waypoints": [{"name": "end", "time_s": 1.0, "position_m": PLACE}],
        },
        FlightSettings(PAIR, PLACE, (FlightWaypoint("end", 1.0, PLACE),)),
    ),
]


def section(values: dict[str, Any]) -> Any:
    return TypeAdapter(ProblemSection).validate_python(values)


@pytest.mark.parametrize(("values", "settings"), LEAST, ids=[values["kind"] for values, _ in LEAST])
def test_the_defaults_are_those_of_the_library(values: dict[str, Any], settings: Any) -> None:
    assert problem_settings(section(values)) == settings


def test_every_kind_is_among_them() -> None:
    kinds = TypeAdapter(ProblemSection).json_schema()["discriminator"]["mapping"]
    assert {values["kind"] for values, _ in LEAST} == set(kinds)


def test_phases_and_angles_arrive() -> None:
    phases = [{"duration_s": 0.2, "air": ["left"], "height_m": 0.03}, {"duration_s": 0.1}]
    settings = problem_settings(section({"kind": "gait", "phases": phases, "yaw_rate_deg_s": 90.0}))
    assert settings.pattern == (GaitPhase(0.2, ["left"], 0.03), GaitPhase(0.1))
    assert settings.yaw_rate == pytest.approx(1.5707963267948966)
    assert problem_settings(section({"kind": "jump", "yaw_deg": -180.0})).yaw == pytest.approx(-3.141592653589793)
