import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from lgmpc.errors import InputError
from lgmpc.simulation.disturbances import Push, PushSchedule

BODIES = ("base_link", "FL_SHOULDER", "FR_SHOULDER")


def applied(schedule: PushSchedule, dt: float, steps: int) -> dict[str, np.ndarray]:
    """Impulses that a plant stepping through the schedule gives to each body."""
    total = {body: np.zeros(6) for body in schedule.bodies}
    for k in range(steps):
        for body, wrench in schedule.wrenches(k * dt).items():
            total[body] += wrench * dt
    return total


@settings(deadline=None)
@given(
    dt=st.sampled_from([1e-3, 1 / 3000, 5e-4, 2e-3]),
    time=st.floats(0.0, 0.2),
    duration=st.floats(1e-5, 0.2),
    impulse=st.tuples(*[st.floats(-10, 10)] * 3),
)
def test_applied_impulse_is_the_demanded_one(dt, time, duration, impulse):
    schedule = PushSchedule([Push(body="base_link", time_s=time, duration_s=duration, impulse_ns=impulse)], dt, BODIES)
    total = applied(schedule, dt, math.ceil((time + duration) / dt) + 2)["base_link"]
    np.testing.assert_allclose(total[:3], impulse, rtol=1e-12, atol=1e-13)
    assert not total[3:].any()


def test_a_push_on_whole_steps_is_constant_and_ends_sharply():
    push = Push(body="base_link", time_s=0.5, duration_s=0.2, impulse_ns=(0.0, 2.0, 0.0))
    schedule = PushSchedule([push], 1e-3, BODIES)
    forces = np.array([schedule.wrenches(k * 1e-3)["base_link"][1] for k in range(1000)])
    on = np.flatnonzero(forces)
    assert (on[0], on[-1], on.size) == (500, 699, 200)
    np.testing.assert_allclose(forces[on], 10.0, rtol=1e-14)
    np.testing.assert_array_equal(push.force, (0.0, 10.0, 0.0))
    assert schedule.is_active(0.5) and not schedule.is_active(0.499) and not schedule.is_active(0.7)


def test_a_push_shorter_than_the_snapping_keeps_its_impulse():
    schedule = PushSchedule(
        [Push(body="base_link", time_s=0.01, duration_s=1e-12, impulse_ns=(1.0, 0.0, 0.0))], 1e-3, BODIES
    )
    np.testing.assert_allclose(applied(schedule, 1e-3, 20)["base_link"][:3], (1.0, 0.0, 0.0), rtol=1e-9)


def test_pushes_overlap_and_act_on_their_own_bodies():
    pushes = [
        Push(body="base_link", time_s=0.0, duration_s=0.01, impulse_ns=(1.0, 0.0, 0.0)),
        Push(body="base_link", time_s=0.005, duration_s=0.01, impulse_ns=(0.0, 1.0, 0.0)),
        Push(body="FL_SHOULDER", time_s=0.0, duration_s=0.02, impulse_ns=(0.0, 0.0, 1.0)),
    ]
    schedule = PushSchedule(pushes, 1e-3, BODIES)
    assert schedule.bodies == ("base_link", "FL_SHOULDER")
    both = schedule.wrenches(0.007)
    np.testing.assert_allclose(both["base_link"], (100, 100, 0, 0, 0, 0), rtol=1e-12)
    np.testing.assert_allclose(both["FL_SHOULDER"], (0, 0, 50, 0, 0, 0), rtol=1e-12)
    # After its own push a body has a zero wrench although another is still pushed.
    assert not schedule.wrenches(0.017)["base_link"].any()


def test_wrenches_cannot_be_changed_by_a_reader():
    schedule = PushSchedule(
        [Push(body="base_link", time_s=0.0, duration_s=0.01, impulse_ns=(1.0, 0.0, 0.0))], 1e-3, BODIES
    )
    for time in (0.0, 0.5):
        with pytest.raises(ValueError, match="read-only"):
            schedule.wrenches(time)["base_link"][0] = 1.0


def test_no_pushes():
    schedule = PushSchedule([], 1e-3, BODIES)
    assert schedule.bodies == () and not schedule.wrenches(0.0) and not schedule.is_active(0.0)


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        (("base_link", -0.1, 0.2, (0, 1, 0)), "time_s"),
        (("base_link", math.nan, 0.2, (0, 1, 0)), "time_s"),
        (("base_link", 0.1, 0.0, (0, 1, 0)), "duration_s"),
        (("base_link", 0.1, -0.2, (0, 1, 0)), "duration_s"),
        (("base_link", 0.1, math.inf, (0, 1, 0)), "duration_s"),
        (("base_link", 0.1, 0.2, (0, math.nan, 0)), "impulse_ns.1"),
        (("base_link", 0.1, 0.2, (0, 1)), "impulse_ns"),
    ],
)
def test_bad_push_is_refused_by_name(arguments, name):
    with pytest.raises(InputError) as caught:
        Push(**dict(zip(Push.model_fields, arguments, strict=True)))
    assert caught.value.argument == name


def test_unknown_body_names_the_nearest():
    pushes = [
        Push(body="base_link", time_s=0.0, duration_s=0.1, impulse_ns=(0, 1, 0)),
        Push(body="base_lnk", time_s=0.0, duration_s=0.1, impulse_ns=(0, 1, 0)),
    ]
    with pytest.raises(InputError) as caught:
        PushSchedule(pushes, 1e-3, BODIES)
    assert caught.value.argument == "pushes.1.body"
    assert caught.value.suggestions[0] == "base_link"


def test_bad_dt_is_refused():
    with pytest.raises(InputError, match="dt"):
        PushSchedule([], 0.0, BODIES)
