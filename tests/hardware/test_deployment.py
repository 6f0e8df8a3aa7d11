"""The loop that runs a controller on a robot: what it does when measurements or commands are not as they should be."""

import dataclasses
import time
from collections.abc import Sequence

import numpy as np
import pytest

from lgmpc.control import Command, Measurement, RobotState
from lgmpc.hardware import DeployedTick, DeploymentSettings, JointLimits, Operator, StopReason, deploy
from lgmpc.timegrid import TimeGrid

NU, PERIOD = 2, 0.001
QUICK = DeploymentSettings(silence_s=0.002, lost_s=0.5, damping_nms=0.3)


def at(tick: float) -> Measurement:
    return Measurement(tick * PERIOD, np.zeros(3), np.zeros(3), np.full(NU, 0.1), np.zeros(NU), np.zeros(NU))


class ScriptedRobot:
    """A driver that offers measurements in given batches, and none afterwards."""

    def __init__(self, *batches: Sequence[float]) -> None:
        self.batches, self.written, self.closed = list(batches), list[Command](), False

    def read(self, timeout_s: float) -> list[Measurement]:
        batch = self.batches.pop(0) if self.batches else []
        if not batch:
            time.sleep(timeout_s)
        return [at(tick) for tick in batch]

    def write(self, command: Command) -> None:
        assert not self.closed
        self.written.append(command)

    def close(self) -> None:
        self.closed = True


class Copying:
    """An estimator of a robot without a base, and a controller whose torque is the number of its decision."""

    def __init__(self) -> None:
        self.estimated: list[float] = []
        self.decided: list[float] = []
        self.torque = 1.0

    def estimate(self, m: Measurement) -> RobotState:
        self.estimated.append(m.time)
        return RobotState(m.time, m.joints, m.speeds)

    def decide(self, state: RobotState) -> Command:
        self.decided.append(state.time)
        return Command.feed_forward(np.full(NU, self.torque), np.zeros(NU))


class Part:
    def __init__(self, update: object) -> None:
        self.update = update


def run(robot: ScriptedRobot, copying: Copying, ticks: int, **options: object) -> object:
    controller, estimator = Part(copying.decide), Part(copying.estimate)
    return deploy(robot, controller, estimator, ticks=TimeGrid(PERIOD, ticks), settings=QUICK, **options)  # type: ignore[arg-type]


def is_damping(command: Command) -> bool:
    return not command.tau.any() and not command.kp.any() and bool((command.kd == QUICK.damping_nms).all())


def test_each_measurement_is_answered_and_the_joints_are_damped_at_the_end() -> None:
    robot, copying = ScriptedRobot([0], [1], [2], [3]), Copying()
    found = run(robot, copying, 3)
    assert (found.ending, found.ticks, found.overtaken, found.missing) == (StopReason.DURATION, 3, 0, 0)
    assert [is_damping(command) for command in robot.written] == [False] * 3 + [True]
    assert robot.closed
    assert found.spent.shape == (3,) and (found.spent > 0.0).all()


def test_the_estimator_receives_all_measurements_and_the_controller_the_newest() -> None:
    robot, copying = ScriptedRobot([0], [1, 2, 3], [6]), Copying()
    found = run(robot, copying, 7)
    assert (found.ticks, found.overtaken, found.missing) == (3, 2, 2)
    np.testing.assert_allclose(copying.estimated, PERIOD * np.array([0, 1, 2, 3, 6]))
    np.testing.assert_allclose(copying.decided, PERIOD * np.array([0, 3, 6]))


def test_silence_damps_the_joints_once_and_what_is_lost_ends_the_run() -> None:
    robot, copying = ScriptedRobot([0], [], [], [1]), Copying()
    found = run(robot, copying, 100)
    assert (found.ending, found.ticks, found.silences) == (StopReason.LOST, 2, 2)
    assert [is_damping(command) for command in robot.written] == [False, True, False, True, True]


def test_a_robot_that_never_answers_ends_the_run_without_a_command() -> None:
    robot = ScriptedRobot()
    found = run(robot, Copying(), 100)
    assert (found.ending, found.ticks, robot.written) == (StopReason.LOST, 0, [])
    assert robot.closed


def test_a_command_that_is_not_finite_damps_the_joints() -> None:
    robot, copying = ScriptedRobot([0], [1]), Copying()
    copying.torque = np.nan
    found = run(robot, copying, 2)
    assert (found.ending, found.refused) == (StopReason.DURATION, 2)
    assert all(map(is_damping, robot.written))


def test_supply_temperatures_and_errors_of_drives_are_reported(caplog: pytest.LogCaptureFixture) -> None:
    class Measuring(ScriptedRobot):
        def read(self, timeout_s: float) -> list[Measurement]:
            return [
                m._replace(
                    supply_voltage=24.0 - m.time,
                    motor_temperature=np.array([30.0, 40.0 + m.time]),
                    error_flags=np.array([0, 5 if m.time > 0.0 else 1]),
                )
                for m in super().read(timeout_s)
            ]

    found = run(Measuring([0], [1], [2]), Copying(), 3)
    assert (found.lowest_supply_v, found.highest_temperature_c) == (23.998, 40.002)
    np.testing.assert_array_equal(found.error_flags, [0, 5])
    assert [each.message for each in caplog.records if "drive" in each.message] == [
        "the drive of joint 1 reports error 0x1 at 0.000 s",
        "the drive of joint 1 reports error 0x5 at 0.001 s",
    ]
    silent = run(ScriptedRobot([0]), Copying(), 1)
    assert silent.lowest_supply_v is silent.highest_temperature_c is silent.error_flags is None


@pytest.mark.parametrize(
    ("error", "ending", "failure"),
    [
        (KeyboardInterrupt(), StopReason.INTERRUPTED, ""),
        (
            RuntimeError("no  idea"),
            StopReason.FAILED,
            "ended early, after 1 ticks: RuntimeError: no idea (test_deployment.py",
        ),
        (SystemExit(3), StopReason.FAILED, "ended early, after 1 ticks: SystemExit: 3 (test_deployment.py"),
    ],
)
def test_whatever_ends_it_the_last_command_damps_the_joints(
    error: BaseException, ending: StopReason, failure: str
) -> None:
    robot = ScriptedRobot([0], [1])

    def stop(tick: DeployedTick) -> None:
        raise error

    found = run(robot, Copying(), 2, on_tick=stop)
    assert (found.ending, found.failure[: len(failure)]) == (ending, failure)
    assert [is_damping(command) for command in robot.written] == [False, True]
    assert robot.closed


@pytest.mark.parametrize(
    ("batches", "slow"), [([[0], [1], [2, 3, 4]], True), ([[k] for k in range(30)] + [[30, 31]], False)]
)
def test_a_machine_that_is_too_slow_is_named(
    batches: list[list[int]], slow: bool, caplog: pytest.LogCaptureFixture
) -> None:
    found = run(ScriptedRobot(*batches), Copying(), batches[-1][-1] + 1)
    figures = dataclasses.replace(found, late=0)  # whatever this machine did meanwhile
    assert figures.too_slow.startswith("this machine is too slow: 2 of 5 measurements") is slow
    assert bool(figures.too_slow) is slow
    late = dataclasses.replace(figures, late=figures.ticks)
    assert late.too_slow and "lower wbc.rate_hz" in late.too_slow
    assert not dataclasses.replace(late, overtaken=0).too_slow  # in lock step the robot waits
    if slow:
        assert [each.message for each in caplog.records][-1].startswith("this machine is too slow")


def test_a_driver_that_cannot_write_is_closed() -> None:
    class Broken(ScriptedRobot):
        def write(self, command: Command) -> None:
            raise OSError("no bus")

    robot = Broken([0])
    assert "OSError: no bus" in run(robot, Copying(), 2).failure
    assert robot.closed


@pytest.mark.parametrize(
    ("batches", "misdated"), [([[0], [1], [-1], [2], [3]], 1), ([[0], [1], [1], [1e9], [2], [3]], 2)]
)
def test_single_measurements_of_a_wrong_time_are_ignored_by_name(
    batches: list[list[float]], misdated: int, caplog: pytest.LogCaptureFixture
) -> None:
    robot, copying = ScriptedRobot(*batches), Copying()
    found = run(robot, copying, 4)
    assert (found.ending, found.ticks, found.misdated) == (StopReason.DURATION, 4, misdated)
    np.testing.assert_allclose(copying.estimated, PERIOD * np.arange(4))
    assert "it is ignored" in caplog.text and "clock" in caplog.text


@pytest.mark.parametrize(
    ("times", "words"),
    [
        ([-5000.0 + k for k in range(600)], "jumped: a measurement at -5 s follows one at 0.001 s"),
        ([1e9 + k for k in range(600)], "jumped: a measurement at 1e+06 s follows one at 0.001 s"),
        ([1.0] * 600, "stands still: a measurement at 0.001 s"),
    ],
)
def test_a_clock_that_jumps_or_stands_still_ends_the_run_by_name(times: list[float], words: str) -> None:
    """Before, a jump ahead ended it as if its duration were over."""

    class Steady(ScriptedRobot):
        def read(self, timeout_s: float) -> list[Measurement]:
            time.sleep(1e-3)
            return super().read(timeout_s)

    robot, copying = Steady([0], [1], *([each] for each in times)), Copying()
    found = run(robot, copying, 3000)
    assert found.ending is StopReason.CLOCK and words in found.failure
    assert found.ticks == 2 and is_damping(robot.written[-1])


def test_times_are_counted_from_the_first_measurement() -> None:
    robot, copying = ScriptedRobot([7e6], [7e6 + 1]), Copying()
    found = run(robot, copying, 2)
    assert found.ending is StopReason.DURATION
    np.testing.assert_allclose(copying.decided, [0.0, PERIOD], atol=1e-9)


LIMITS = JointLimits(("hip", "knee"), np.full(NU, 2.0), np.full(NU, 10.0))


@pytest.mark.parametrize(
    ("quantity", "value", "words"),
    [
        ("speeds", [0.0, -30.0], "knee turns at -30 rad/s, not at most 20 (max_speed_share 2)"),
        ("motor_temperature", [90.0, 20.0], "hip has 90 degrees (max_temperature_c 80)"),
        ("torques", [0.0, 1.9], "the RMS torque of knee is more than 0.5 of its limit (max_rms_torque_share)"),
    ],
)
def test_limits_stop_the_robot_by_name(quantity: str, value: list[float], words: str) -> None:
    class Beyond(ScriptedRobot):
        def read(self, timeout_s: float) -> list[Measurement]:
            return [m._replace(**{quantity: np.array(value)}) for m in super().read(timeout_s)]

    copying, settings = Copying(), QUICK.model_copy(update={"max_rms_torque_share": 0.5, "rms_torque_s": 0.01})
    robot = Beyond(*([k] for k in range(30)))
    options = {"ticks": TimeGrid(PERIOD, 30), "settings": settings, "limits": LIMITS}
    found = deploy(robot, Part(copying.decide), Part(copying.estimate), **options)  # type: ignore[arg-type]
    assert found.ending is StopReason.LIMIT and words in found.failure
    assert 2 <= found.ticks < 6 and is_damping(robot.written[-1])
    single = Beyond([0])  # one reading may be a fault of the sensor
    assert quantity == "torques" or deploy(
        single, Part(copying.decide), Part(copying.estimate), **{**options, "ticks": TimeGrid(PERIOD, 1)}  # type: ignore[arg-type]
    ).ending is StopReason.DURATION  # fmt: skip


def test_torques_are_cut_and_rise_at_the_start(caplog: pytest.LogCaptureFixture) -> None:
    robot, copying = ScriptedRobot(*([k] for k in range(6))), Copying()
    copying.torque = 3.0
    settings = QUICK.model_copy(update={"soft_start_s": 4 * PERIOD})
    controller, estimator = Part(copying.decide), Part(copying.estimate)
    deploy(robot, controller, estimator, ticks=TimeGrid(PERIOD, 6), settings=settings, limits=LIMITS)
    np.testing.assert_allclose([c.tau[0] for c in robot.written], [0.0, 0.5, 1.0, 1.5, 2.0, 2.0, 0.0])
    np.testing.assert_allclose([c.kd[0] for c in robot.written], [0.3, 0.225, 0.15, 0.075, 0.0, 0.0, 0.3])
    robot, copying.torque = ScriptedRobot([0]), 1e300
    deploy(robot, controller, estimator, ticks=TimeGrid(PERIOD, 1), settings=QUICK, limits=LIMITS)
    assert all(map(is_damping, robot.written))
    assert "the command at 0.000 s is beyond bounds (tau[0] is 1e+300, more than 20)" in caplog.text


class Wishes(Operator):
    """An operator whose wishes follow from the number of ticks so far."""

    def __init__(self, copying: Copying, **at_tick: int) -> None:
        super().__init__(armed="arm" not in at_tick)
        self.copying, self.at_tick, self.polls = copying, at_tick, 0

    def poll(self) -> None:
        self.polls += 1
        ticks, wishes = len(self.copying.decided), self.at_tick
        self.armed = self.armed or self.polls > wishes.get("arm", 1000)
        self.armed = self.armed and ticks < wishes.get("disarm", 1000)
        self.lies = self.lies or ticks >= wishes.get("lie", 1000)
        if ticks >= wishes.get("stop", 1000):
            self.stop = "emergency stop by key"


def test_the_emergency_stop_has_a_name() -> None:
    robot, copying = ScriptedRobot(*([k] for k in range(9))), Copying()
    found = run(robot, copying, 9, operator=Wishes(copying, stop=3))
    assert (found.ending, found.failure, found.ticks) == (StopReason.STOPPED, "emergency stop by key", 3)
    assert [is_damping(command) for command in robot.written] == [False] * 3 + [True]


def test_nothing_is_sent_before_arming_and_disarming_damps() -> None:
    robot, copying = ScriptedRobot(*([k] for k in range(9))), Copying()
    found = run(robot, copying, 5, operator=Wishes(copying, arm=4, disarm=3))
    assert (found.ending, found.ticks) == (StopReason.DURATION, 5)
    assert [is_damping(command) for command in robot.written] == [False] * 3 + [True] * 3
    np.testing.assert_allclose(copying.decided, PERIOD * np.arange(5), atol=1e-12)  # the run begins when it is armed


@pytest.mark.parametrize(("wishes", "ending", "recorded"), [({}, "DURATION", 4), ({"lie": 2}, "INTERRUPTED", 2)])
def test_the_robot_lies_down_after_the_run(wishes: dict[str, int], ending: str, recorded: int) -> None:
    robot, copying, seen = ScriptedRobot(*([k] for k in range(20))), Copying(), list[bool]()
    operator, ticks = Wishes(copying, **wishes), list[DeployedTick]()

    def decide(state: RobotState) -> Command:
        seen.append(operator.lies)
        return copying.decide(state)

    settings = QUICK.model_copy(update={"lie_down_s": 5 * PERIOD})
    options = {"settings": settings, "operator": operator, "on_tick": ticks.append}
    found = deploy(
        robot, Part(decide), Part(copying.estimate), ticks=TimeGrid(PERIOD, 4), **options  # type: ignore[arg-type]
    )  # fmt: skip
    assert (found.ending, len(ticks)) == (StopReason[ending], recorded)
    assert 5 <= sum(seen) <= 7 and seen == sorted(seen)
