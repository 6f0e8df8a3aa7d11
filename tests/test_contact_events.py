"""Contact events in closed loop, on a floor that is higher or lower under one foot of a trotting robot.

The floor under one foot is moved by moving that foot's sphere along its leg in the plant, which the controller does not
measure: further down it touches as on a step, further up as in a hole.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from lgmpc.config.build import prepare
from lgmpc.config.closed_loop import ClosedLoopSession
from lgmpc.config.loading import load_config
from lgmpc.locomotion.contacts import ContactState
from lgmpc.runs import Metrics, RunLog
from lgmpc.runs.log import CONTACT_STATES
from lgmpc.simulation.mujoco import MujocoPlant
from lgmpc.typing import Array

CONFIG = Path(__file__).parent.parent / "configs" / "solo12_velocity.yaml"
FOOT = 0


class ScriptedFloor:
    """The plant of a session with a floor that moves under one foot.

    Args:
        session: whose plant is wrapped.
        height: of the floor under the foot while it is moved, m.
        begins: whether the floor moves now, for time and contact state of the foot; it moves once.
        lasts: for so long at least, s: it does not come back into a foot that is below it.
    """

    def __init__(
        self, session: ClosedLoopSession, height: float, begins: Callable[[float, ContactState], bool], lasts: float
    ) -> None:
        assert isinstance(session.plant, MujocoPlant)
        self._plant, self._feet, self._step = session.plant, session.controller.feet, session.plant.step
        self._geom = session.plant.model.geom(f"foot {session.robot.contact_frames[FOOT]}").id
        self._place = session.plant.model.geom_pos[self._geom].copy()
        self._body = session.plant.model.geom_bodyid[self._geom]
        self._radius = session.plant.model.geom_size[self._geom, 0]
        self._height, self._begins, self._lasts = height, begins, lasts
        self.begun, self._moved = np.inf, False
        session.plant.step = self.step  # type: ignore[method-assign]

    def step(self, tau: Array) -> None:
        time = self._plant.data.time
        if np.isinf(self.begun) and self._begins(time, self._feet.events.states[FOOT]):
            self.begun = time
        data = self._plant.data
        lowest = data.xpos[self._body, 2] + data.xmat[self._body, 6:] @ self._place - self._radius
        lasts = time < self.begun + self._lasts or (self._moved and lowest < -0.001)
        self._moved = time >= self.begun and lasts
        self._plant.model.geom_pos[self._geom] = self._place
        self._plant.model.geom_pos[self._geom, 2] -= self._height if self._moved else 0.0
        self._step(tau)


def walked(
    height: float, begins: Callable[[float, ContactState], bool], lasts: float, gait: str = "trot", age: float = 0.0
) -> tuple[RunLog, Metrics, float]:
    """Return the log of 0.3 m/s ahead until 1.4 s and a stop, its metrics, and when the floor moved.

    Measurements arrive after ``age``, s, which the controller compensates.
    """
    ahead = f"{{at_s: 0.1, velocity_m_s: [0.3, 0.0, 0.0], gait: {gait}}}"
    commands = f"commands=[{ahead}, {{at_s: 1.4, velocity_m_s: [0.0, 0.0, 0.0]}}]"
    late = [f"plant.link.measurement_latency_s={age}", f"delays.measurement_s={age}"]
    session = prepare(load_config(CONFIG, [commands, "duration_s=2.6", *late]))
    assert isinstance(session, ClosedLoopSession)
    floor = ScriptedFloor(session, height, begins, lasts)
    metrics = session.run(lambda progress: None).metrics
    assert metrics is not None and np.isfinite(floor.begun)
    return session.recorder.log(), metrics, floor.begun


def in_swing(time: float, state: ContactState) -> bool:
    return time > 0.8 and state is ContactState.SWING


def states_after(log: RunLog, begin: float, seconds: float) -> list[str]:
    """Return the states of the foot in order, from ``begin`` on."""
    assert log.contact_states is not None
    states = log.contact_states[(log.time >= begin) & (log.time < begin + seconds), FOOT]
    return [CONTACT_STATES[k] for k in states[np.concatenate(([0], np.flatnonzero(np.diff(states)) + 1))].tolist()]


def check_it_walks_on(log: RunLog, metrics: Metrics, begin: float) -> None:
    """The robot neither falls nor tilts, no torque is lost, and it ends standing at the same height."""
    assert metrics.falls == 0 and metrics.solver_failures == 0
    assert metrics.max_tilt_deg < 4.0
    assert metrics.walking is not None and metrics.walking.ends_standing
    assert log.q[-1, 2] == pytest.approx(0.232, abs=0.003)
    speed = np.diff(log.com[:, 0])[(log.time[1:] > begin + 0.3) & (log.time[1:] < 1.4)] / 1e-3
    assert speed.mean() == pytest.approx(0.3, abs=0.03)


def test_an_early_foot_stands_at_once() -> None:
    """A step of 12 mm: the foot touches before its swing ends, and carries from then on."""
    log, metrics, begin = walked(0.012, in_swing, 0.24)
    states = states_after(log, begin, 0.24)
    assert states[:2] == ["swing", "early"]
    assert log.contact_states is not None
    early = np.flatnonzero(log.contact_states[:, FOOT] == CONTACT_STATES.index("early"))[0]
    touched = np.flatnonzero((log.contact_forces[:, FOOT, 2] > 0.1) & (log.time > begin + 0.05))[0]
    assert 0 <= early - touched <= 5  # ticks: the time for which a contact is measured until it counts
    assert log.contact_forces[early : early + 60, FOOT, 2].max() > 3.0
    check_it_walks_on(log, metrics, begin)


@pytest.mark.parametrize("depth", [0.003, 0.012])
def test_a_late_foot_descends_until_it_stands(depth: float) -> None:
    """A hole: the schedule waits until the foot finds the ground."""
    log, metrics, begin = walked(-depth, in_swing, 0.24)
    states = states_after(log, begin, 0.24)
    assert "late" in states
    assert states[states.index("late") + 1] == "stance"
    check_it_walks_on(log, metrics, begin)


def test_a_foot_that_loses_its_contact_regains_it() -> None:
    """The floor falls by 3.5 cm early in a long stance: the foot is pressed down, and stands before it counts as lost.

    The robot walks on. Its base does not follow one low foot: 2.3 degrees.
    """
    stance = [0.8]

    def in_stance(time: float, state: ContactState) -> bool:
        stance[0] = stance[0] if state is ContactState.STANCE else time
        return time > 0.8 and 0.02 < time - stance[0] < 0.03

    log, metrics, begin = walked(-0.035, in_stance, 0.25, "walk")
    assert states_after(log, begin, 0.25) == ["stance"]
    touched = log.time[(log.contact_forces[:, FOOT, 2] > 0.1) & (log.time > begin + 0.002)]
    assert touched[0] - begin < 0.035
    check_it_walks_on(log, metrics, begin)


AGE = 0.008


def test_measurements_that_arrive_late_delay_no_touchdown() -> None:
    """The floor is flat: feet carry from the tick at which they touch it, not from that of the measurement."""
    log, metrics, begin = walked(0.0, in_swing, 0.24, age=AGE)
    check_it_walks_on(log, metrics, begin)
    assert log.stance is not None
    carries, touches = log.stance.astype(bool), log.contact_forces[:, :, 2] > 0.0
    behind = []
    for foot in range(4):
        lands = [np.flatnonzero(each[1:, foot] & ~each[:-1, foot]) for each in (carries, touches)]
        behind += [tick - lands[1][np.abs(lands[1] - tick).argmin()] for tick in lands[0].tolist()]
    assert len(behind) > 20
    assert abs(np.median(behind)) <= 2 and np.percentile(np.abs(behind), 90) <= 5  # ticks of 1 ms


@pytest.mark.parametrize("height", [0.012, -0.012])
def test_a_step_and_a_hole_are_walked_over_on_old_measurements(height: float) -> None:
    log, metrics, begin = walked(height, in_swing, 0.24, age=AGE)
    states = states_after(log, begin, 0.24)
    assert ("early" if height > 0.0 else "late") in states
    check_it_walks_on(log, metrics, begin)
