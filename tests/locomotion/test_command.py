"""Commands: timelines, functions, and the limiter that arrives exactly."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given, strategies as st

from lgmpc.errors import InputError
from lgmpc.locomotion.command import (
    CommandEntry,
    CommandFunction,
    CommandLimiter,
    CommandLimits,
    CommandTimeline,
    MotionCommand,
    Timeline,
)
from lgmpc.settings import Settings


class _Document(Settings):
    commands: Timeline = ()


ENTRIES = [
    CommandEntry(at_s=1.0, velocity_m_s=(0.5, 0.0, 0.0), gait="walk"),
    CommandEntry(at_s=2.0, yaw_rate_rad_s=1.0),
    CommandEntry(at_s=3.0, velocity_m_s=(0.0, 0.1, 0.0), height_m=-0.05, pitch_rad=0.1, roll_rad=-0.1),
]


def test_an_entry_changes_only_what_it_names() -> None:
    source = CommandTimeline(ENTRIES)
    assert source.at(0.999) == MotionCommand()
    assert source.at(1.0) == MotionCommand(vx=0.5, gait="walk")
    assert source.at(2.5) == MotionCommand(vx=0.5, yaw_rate=1.0, gait="walk")
    last = MotionCommand(0.0, 0.1, 1.0, -0.05, 0.1, -0.1, "walk")
    assert source.at(100.0) == last
    assert source.at(0.0) == MotionCommand()  # back in time


def test_entries_out_of_order_name_the_key() -> None:
    values = [{"at_s": 1.0}, {"at_s": 3.0}, {"at_s": 2.0}]
    with pytest.raises(InputError, match="not before that of the entry ahead of it") as caught:
        _Document(commands=values)  # type: ignore[arg-type]
    assert caught.value.argument == "commands.2.at_s"
    with pytest.raises(InputError) as caught:
        CommandTimeline([CommandEntry(**value) for value in values])  # type: ignore[arg-type]
    assert caught.value.argument == "commands.2.at_s"


@pytest.mark.parametrize(
    ("entry", "key"),
    [
        ({"velocity_m_s": [0.5, 0.0, 0.1]}, "commands.0.velocity_m_s"),
        ({"velocity_m_s": [0.5, 0.0]}, "commands.0.velocity_m_s"),
        ({"pitch_rad": 1.5}, "commands.0.pitch_rad"),
        ({"speed": 1.5}, "commands.0.speed"),
        ({"at_s": -1.0}, "commands.0.at_s"),
    ],
)
def test_a_bad_entry_is_refused_by_key(entry: dict[str, object], key: str) -> None:
    with pytest.raises(InputError) as caught:
        _Document(commands=[{"at_s": 1.0, **entry}])  # type: ignore[arg-type]
    assert caught.value.argument == key


def test_an_unknown_gait_names_its_entry_and_the_nearest() -> None:
    with pytest.raises(InputError, match="Did you mean trot") as caught:
        CommandTimeline([CommandEntry(at_s=0.0), CommandEntry(at_s=0.0, gait="trott")], gaits=("trot", "walk"))
    assert caught.value.argument == "commands.1.gait"


def test_a_velocity_without_a_gait_needs_the_default_one() -> None:
    entries = [CommandEntry(at_s=0.0, height_m=-0.01), CommandEntry(at_s=1.0, yaw_rate_rad_s=0.1)]
    assert CommandTimeline(entries[:1], gaits=("stand", "ripple")).at(0.5).height == -0.01
    with pytest.raises(InputError, match=r"commands\.1\.gait: got no name, and so trot; .* Valid: stand, ripple"):
        CommandTimeline(entries, gaits=("stand", "ripple"))


def test_a_function_is_a_source() -> None:
    source = CommandFunction(lambda t: MotionCommand(vx=t))
    assert source.at(0.3).vx == 0.3
    for bad in (math.nan, None, "0.1"):
        with pytest.raises(InputError, match=f"command.yaw_rate: got {bad}; expected a finite number"):
            CommandFunction(lambda t, bad=bad: MotionCommand(yaw_rate=bad)).at(0.0)  # type: ignore[misc]
    with pytest.raises(InputError, match="a MotionCommand"):
        CommandFunction(lambda t: (0.5, 0.0)).at(0.0)  # type: ignore[arg-type, return-value]


numbers = st.floats(-2.0, 2.0)
commands = st.builds(MotionCommand, numbers, numbers, numbers, numbers, numbers, numbers, st.sampled_from(["a", "b"]))


@given(commands, commands, st.floats(1e-3, 0.1))
def test_the_limiter_keeps_its_rates_and_arrives_exactly(begin: MotionCommand, end: MotionCommand, dt: float) -> None:
    limits = CommandLimits()
    limiter = CommandLimiter(limits, begin)
    before = begin
    distance = math.hypot(end.vx - begin.vx, end.vy - begin.vy)
    for _ in range(int(50.0 / dt)):
        now = limiter.step(end, dt)
        assert math.hypot(now.vx - before.vx, now.vy - before.vy) <= limits.acceleration_m_s2 * dt + 1e-12
        assert abs(now.yaw_rate - before.yaw_rate) <= limits.yaw_acceleration_rad_s2 * dt + 1e-12
        assert abs(now.height - before.height) <= limits.height_rate_m_s * dt + 1e-12
        assert abs(now.pitch - before.pitch) <= limits.attitude_rate_rad_s * dt + 1e-12
        assert abs(now.roll - before.roll) <= limits.attitude_rate_rad_s * dt + 1e-12
        left = math.hypot(end.vx - now.vx, end.vy - now.vy)
        assert left <= distance + 1e-12  # never away from it
        distance, before = left, now
        assert now.gait == end.gait
        if now == end:
            break
    assert limiter.command == end
    assert limiter.step(end, dt) == end


def test_commands_beyond_the_largest_speed_keep_their_direction() -> None:
    limits = CommandLimits(speed_m_s=1.0, yaw_rate_rad_s=2.0)
    limiter = CommandLimiter(limits)
    command = MotionCommand(vx=3.0, vy=4.0, yaw_rate=-5.0)
    for _ in range(10_000):
        now = limiter.step(command, 1e-2)
    assert (now.vx, now.vy, now.yaw_rate) == pytest.approx((0.6, 0.8, -2.0))


def test_only_velocities_move() -> None:
    assert not MotionCommand(height=0.1, pitch=0.1).moves
    assert replace(MotionCommand(), yaw_rate=0.1).moves


def test_a_floor_that_allows_less_acceleration_slows_the_change_of_velocity() -> None:
    limiter = CommandLimiter(CommandLimits(acceleration_m_s2=1.0))
    for _ in range(100):
        command = limiter.step(MotionCommand(vx=0.4, gait="trot"), 1e-3, 0.5)
    assert command.vx == pytest.approx(0.05)
    assert (limiter.ramp.ax, limiter.ramp.duration) == pytest.approx((0.5, 0.7))  # as the MPC expects it
    for _ in range(100):
        command = limiter.step(MotionCommand(vx=0.4, gait="trot"), 1e-3, 2.0)
    assert command.vx == pytest.approx(0.15)
