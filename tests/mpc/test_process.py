"""An MPC in a process of its own: plans arrive later, the process may stop, end, and be started anew."""

from __future__ import annotations

import time
from collections.abc import Iterator
from functools import partial
from multiprocessing import Pipe, RawArray
from typing import Any

import numpy as np
import pytest

from lgmpc.locomotion.horizon import ContactHorizon, MotionReference
from lgmpc.mpc import CentroidalMpcSettings, MeasuredState, Plan
from lgmpc.mpc.process import ProcessMpc, SharedValues
from lgmpc.status import Status

N = 4
SETTINGS = CentroidalMpcSettings(nodes=N, node_s=0.05)


class Slow:
    """Plans after some time: the mass is the number of the update since the last reset."""

    def __init__(self, seconds: float) -> None:
        self.seconds, self.settings, self.updates = seconds, SETTINGS, 0

    def reset(self) -> None:
        self.updates = 0

    def update(self, state: MeasuredState, *arguments: Any) -> Plan:
        time.sleep(self.seconds)
        self.updates += 1
        xs = np.tile(np.concatenate([state.com, state.momentum]), (N + 1, 1))
        return Plan(state.time, 0.05, float(self.updates), xs, np.zeros((N, 1, 3)), Status.STEPPED, 0, 0.0)


def apart(seconds: float) -> ProcessMpc:
    return ProcessMpc(partial(Slow, seconds), SETTINGS)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def shared() -> Iterator[ProcessMpc]:
    mpc = apart(0.1)
    yield mpc
    mpc.close()


def update(mpc: ProcessMpc, t: float) -> Plan:
    state = MeasuredState.centroidal(t, np.full(3, t), np.zeros(6))
    nodes = np.zeros((N + 1, 3))
    motion = MotionReference(nodes, nodes, np.zeros((N + 1, 0)), nodes)
    return mpc.update(state, ContactHorizon.allocate(N, 1), motion, np.zeros((N, 6)))


def arrival(mpc: ProcessMpc) -> None:
    end = time.perf_counter() + 30.0
    while not mpc.arrived and time.perf_counter() < end:
        time.sleep(1e-3)


def test_updates_do_not_wait_and_the_next_one_takes_the_plan(shared: ProcessMpc) -> None:
    first = update(shared, 1.0)
    assert (first.time, first.mass, first.xs[0, 0]) == (1.0, 1.0, 1.0)  # there is none to go on with: it waits
    begun = time.perf_counter()
    assert update(shared, 1.01) is first and update(shared, 1.02) is first
    assert time.perf_counter() - begun < 0.08
    arrival(shared)
    assert update(shared, 1.03).time == 1.01  # of the request that was under way
    assert shared.failures == shared.restarts == 0


def test_a_plan_from_half_a_horizon_ago_is_stale(shared: ProcessMpc) -> None:
    before = update(shared, 2.0).time
    assert update(shared, before + 0.09).status is Status.STEPPED
    assert update(shared, before + 0.11).status is Status.STALE


def test_plans_from_before_a_reset_are_not_followed(shared: ProcessMpc) -> None:
    arrival(shared)
    update(shared, 3.0)
    update(shared, 3.01)  # under way when the reset comes
    shared.reset()
    assert update(shared, 3.02).status is Status.STALE
    arrival(shared)
    assert update(shared, 3.03).status is Status.STALE  # that was the one from before
    assert update(shared, 3.04).status is Status.STALE
    arrival(shared)
    plan = update(shared, 3.05)
    assert (plan.status, plan.time, plan.mass) == (Status.STEPPED, 3.04, 1.0)


@pytest.mark.slow
def test_a_process_that_ends_is_started_anew(caplog: pytest.LogCaptureFixture) -> None:
    mpc = apart(0.0)
    try:
        first = update(mpc, 0.0)
        mpc._process.kill()
        time.sleep(0.1)
        for t in (0.01, 0.02):
            assert update(mpc, t).time == first.time
        assert mpc.restarts == 1 and "ended at" in caplog.text
        arrival(mpc)
        update(mpc, 0.03)  # it says that it is ready
        update(mpc, 0.04)
        arrival(mpc)
        assert update(mpc, 0.05).time == 0.04
    finally:
        mpc.close()


def test_values_go_through_shared_memory_and_others_are_sent_whole() -> None:
    ours, theirs = Pipe()
    memory = RawArray("d", 1000)
    writer, reader = SharedValues(memory), SharedValues(memory)
    rng = np.random.default_rng(0)

    def passed(*values: Any) -> tuple[Any, ...]:
        writer.send(ours, values)
        return reader.receive(theirs, copied=True)

    for size, legs in ((3, None), (3, np.ones((4, 3))), (4, None), (200, None)):
        for _ in range(3):
            contacts = ContactHorizon.allocate(size, 2)
            contacts.flags[:], contacts.points[:] = rng.random((size, 2)) > 0.5, rng.normal(size=(size, 2, 3))
            nodes = rng.normal(size=(4, 3))
            motion = MotionReference(nodes, nodes.T, np.zeros((4, 0)), nodes, True, legs)
            plan = Plan(rng.normal(), 0.05, 2.0, nodes, nodes, Status.ACCEPTABLE, 3, np.nan)
            number, horizon, reference, found = passed(7, contacts, motion, plan)
            assert number == 7 and type(number) is int and found.status is Status.ACCEPTABLE
            assert found.time == plan.time and type(found.qp_iterations) is int and np.isnan(found.update_time)
            assert found.posture is None and reference.catching is True and (reference.legs is None) == (legs is None)
            for mine, given in ((horizon.flags, contacts.flags), (horizon.points, contacts.points), (found.xs, nodes)):
                np.testing.assert_array_equal(mine, given)
                assert mine.dtype == given.dtype
            np.testing.assert_array_equal(reference.com_velocity, nodes.T)
