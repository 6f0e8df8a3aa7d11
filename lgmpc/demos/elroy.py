"""Elroy's beanie: the rotation of a body by a rotor on it, without friction (chapter 4.16)."""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

from lgmpc.demos.outcome import Body, Curve, Outcome, Panel, Row, Shape
from lgmpc.lie import so3
from lgmpc.mechanics import Beanie
from lgmpc.typing import Array

__all__ = ["run"]

DURATION = 4.0
BOY, BLADE = 0.8, 0.25
"""Moments of inertia, kg.m2."""
MOMENTUM = 0.5
"""Angular momentum of the second run, N.m.s."""


def run() -> Outcome:
    """Return the outcome, computed in a few seconds."""
    beanie = Beanie(BOY, BLADE)
    still, turning = _simulate(0.0), _simulate(MOMENTUM)
    times = np.linspace(0.0, DURATION, still.shape[1])
    geometric = beanie.geometric_phase(2.0 * np.pi)
    dynamic = beanie.dynamic_phase(MOMENTUM, DURATION)
    carried = beanie.connection().transport(lambda s: 2.0 * np.pi * s, 10)[-1]
    rows = [
        Row("turn of the propeller on the cap", 360.0, _degrees(still[2, -1] - still[0, -1]), 1e-7, "deg"),
        Row("turn of Elroy, no momentum", _degrees(geometric), _degrees(still[0, -1]), 1e-7, "deg"),
        Row("the same, by transport with the connection", _degrees(geometric), _degrees(float(carried)), 1e-9, "deg"),
        Row("turn of Elroy, with momentum", _degrees(geometric + dynamic), _degrees(turning[0, -1]), 1e-7, "deg"),
    ]
    for name, motion, value in (("no momentum", still, 0.0), ("with momentum", turning, MOMENTUM)):
        found = BOY * motion[1] + BLADE * motion[3]
        worst = found[np.argmax(np.abs(found - value))]
        rows.append(Row(f"largest angular momentum, {name}", value, float(worst), 1e-9, "N.m.s"))
    return Outcome(
        tuple(rows),
        panels=(
            _panel("No momentum", times, still, beanie, 0.0),
            _panel(f"Momentum {MOMENTUM} N.m.s", times, turning, beanie, MOMENTUM),
        ),
        times=times,
        bodies=_scene(still),
        remarks=(
            "Both bodies are integrated by Newton's law with a torque between them, without the connection.",
            "Elroy turns by -I2/(I1 + I2) of the propeller's turn, independent of its speed.",
            "With momentum, the rotation of the locked bodies is added: the dynamic phase.",
        ),
        floor=True,
    )


def _simulate(momentum: float) -> Array:
    """Return (4, n) angle and rate of Elroy, then of the propeller, both in the world."""
    reduced = BOY * BLADE / (BOY + BLADE)
    strength = 4.0 * np.pi**2 * reduced / DURATION**2  # one turn of the propeller, from rest to rest

    def rate(time: float, y: Array) -> Array:
        torque = strength * np.sin(2.0 * np.pi * time / DURATION)
        return np.array([y[1], -torque / BOY, y[3], torque / BLADE])

    speed = momentum / (BOY + BLADE)
    grid = np.linspace(0.0, DURATION, 161)
    start = [0.0, speed, 0.0, speed]
    found = solve_ivp(rate, (0.0, DURATION), start, method="DOP853", t_eval=grid, rtol=1e-12, atol=1e-13)
    states: Array = found.y
    return states


def _degrees(angle: float) -> float:
    return float(np.degrees(angle))


def _panel(title: str, times: Array, motion: Array, beanie: Beanie, momentum: float) -> Panel:
    relative = motion[2] - motion[0]
    predicted = [
        beanie.geometric_phase(float(change)) + beanie.dynamic_phase(momentum, float(time))
        for change, time in zip(relative, times, strict=True)
    ]
    curves = (
        Curve("propeller on the cap", times, np.degrees(relative)),
        Curve("Elroy", times, np.degrees(motion[0])),
        Curve("Elroy, predicted", times, np.degrees(predicted), dashed=True),
    )
    return Panel(title, "time, s", "angle, deg", curves)


def _scene(motion: Array) -> tuple[Body, ...]:
    def turned(angle: Array) -> Array:
        return so3.exp(np.stack((0.0 * angle, 0.0 * angle, angle), axis=1))

    boy = (
        Shape("cylinder", (0.18, 0.18, 0.7), (0.0, 0.0, 0.75), 0x4C78A8),
        Shape("sphere", (0.14, 0.14, 0.14), (0.0, 0.0, 1.25), 0xE8B88F),
        Shape("sphere", (0.03, 0.03, 0.03), (0.14, 0.0, 1.24), 0xD08B6E),
        Shape("box", (0.12, 0.1, 0.4), (0.0, 0.1, 0.2), 0x35506B),
        Shape("box", (0.12, 0.1, 0.4), (0.0, -0.1, 0.2), 0x35506B),
        Shape("box", (0.4, 0.08, 0.08), (0.25, 0.2, 0.95), 0x4C78A8),
        Shape("box", (0.4, 0.08, 0.08), (0.25, -0.2, 0.95), 0x4C78A8),
    )
    blade = (
        Shape("box", (0.7, 0.08, 0.02), (0.0, 0.0, 1.45), 0xE45756),
        Shape("cylinder", (0.015, 0.015, 0.1), (0.0, 0.0, 1.41), 0x333333),
    )
    still = np.zeros((motion.shape[1], 3))
    return Body("elroy", boy, still, turned(motion[0])), Body("propeller", blade, still, turned(motion[2]))
