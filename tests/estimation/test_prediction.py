"""The state in which a command acts: against integration in small steps, and against the simulated robot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.config.build import prepare
from lgmpc.config.closed_loop import ClosedLoopSession
from lgmpc.config.loading import load_config
from lgmpc.control.interface import Command, RobotState
from lgmpc.errors import InputError
from lgmpc.estimation import DelaySettings, StatePredictor

CONFIGS = Path(__file__).parents[2] / "configs"
PERIOD = 1e-3


@pytest.mark.parametrize("age", [0.0, 2.0, 1.3])  # ticks
@pytest.mark.parametrize("lead", [1.0, 3.5])
def test_it_is_the_integral_of_the_accelerations_in_flight(solo12, age: float, lead: float) -> None:
    """Commands of every tick act ``lead`` later; the state is ``age`` old. Integrated in steps of a twentieth."""
    delays = DelaySettings(measurement_s=age * PERIOD, command_s=lead * PERIOD)
    predictor, rng, parts = StatePredictor(solo12, PERIOD, delays), np.random.default_rng(1), 20
    commands = 5.0 * rng.normal(size=(30, solo12.nv))
    q, v = solo12.q_reference.copy(), 0.3 * rng.normal(size=solo12.nv)
    states = [(q, v)]
    for i in range(29 * parts):
        k = int(np.floor((i + 0.5) / parts - lead))
        a = commands[k] if k >= 0 else np.zeros(solo12.nv)
        q = pin.integrate(solo12.model, q, PERIOD / parts * (v + 0.5 * PERIOD / parts * a))
        v = v + PERIOD / parts * a
        states.append((q, v))
    for k in range(20):
        at = round((k - age) * parts)
        if at < 0:
            continue
        predicted = predictor.predict(RobotState(k * PERIOD, *states[at]))
        predictor.expect(commands[k])
        if k < age + lead + 2.0:  # commands from before the first measurement count too
            continue
        q, v = states[round((k + lead) * parts)]
        np.testing.assert_allclose(predicted.v, v, atol=1e-12)
        np.testing.assert_allclose(pin.difference(solo12.model, q, predicted.q), 0.0, atol=3e-7)
        assert predicted.time == pytest.approx((k + lead) * PERIOD)


def test_after_missed_ticks_the_last_command_has_acted_for_longer(solo12) -> None:
    predictor = StatePredictor(solo12, PERIOD, DelaySettings(command_s=4.0 * PERIOD))
    state, a = RobotState(0.0, solo12.q_reference, np.zeros(solo12.nv)), np.arange(float(solo12.nv))
    predictor.predict(state)
    predictor.expect(a)
    late = predictor.predict(RobotState(3.0 * PERIOD, state.q, state.v))
    np.testing.assert_allclose(late.v, 3.0 * PERIOD * a)
    predictor.reset()
    np.testing.assert_array_equal(predictor.predict(state).v, 0.0)


@pytest.mark.parametrize("plant", ["mujoco", pytest.param("pinocchio", marks=pytest.mark.slow)])
def test_in_closed_loop_it_is_the_simulated_state(plant: str) -> None:
    """The centre of mass on a circle, 9 ms of delay: what is predicted is what happens."""
    overrides = [f"plant.kind={plant}", "duration_s=2.0", "reference.ramp_s=0.3"]
    overrides += ["plant.link.command_latency_s=0.005", "plant.link.measurement_latency_s=0.004"]
    overrides += ["delays.command_s=0.005", "delays.measurement_s=0.004", "log.rate_hz=1000"]
    session = prepare(load_config(CONFIGS / "solo12_com_circle.yaml", overrides))
    assert isinstance(session, ClosedLoopSession)
    states: list[tuple[np.ndarray, np.ndarray]] = []
    update = session.controller.update

    def keep(state: RobotState) -> Command:
        command = update(state)
        terms = session.controller.wbc.terms
        states.append((terms.q.copy(), terms.v.copy()))
        return command

    session.controller.update = keep  # type: ignore[method-assign]
    log = session.run(lambda progress: None).log
    model = session.robot.model
    for k in range(1200, 1900, 5):
        (q, v), then, now = states[k], k + 5, k - 4
        moved = np.abs(pin.difference(model, log.q[now], log.q[then])).max()
        gained = np.abs(log.v[then] - log.v[now]).max()
        assert moved > 1e-3 and gained > 5e-3
        assert np.abs(pin.difference(model, log.q[then], q)).max() < 0.02 * moved  # measured 0.8 %
        assert np.abs(log.v[then] - v).max() < 0.07 * gained  # 3 % (MuJoCo, whose contacts yield), 0.4 %


def test_delays_out_of_range_are_refused() -> None:
    for key in ("measurement_s", "command_s"):
        for value in (-0.001, 0.2, float("nan")):
            with pytest.raises(InputError, match=key):
                DelaySettings(**{key: value})
