"""Measurements compared with what joints and a trunk can do within a tick, and replaced where they cannot be true."""

import logging
import math

import numpy as np

from lgmpc.control.interface import Measurement
from lgmpc.robot import Robot
from lgmpc.typing import Array, BoolArray

_LOG = logging.getLogger(__name__)

QUANTITIES = ("gyro", "accelerometer", "joints", "speeds", "torques", "external_pose", "external_velocity")
"""Names of the monitored quantities; bit k of :attr:`MeasurementMonitor.faults` stands for the k-th.

Those of external sources are judged by the estimator, and left out."""

_JUMP = 0.5
"""Share of a joint's velocity limit by which its speed changes at most within a tick; in falls of Solo12 0.4."""
_GYRO_JUMP = 3.0
"""rad/s: greater changes of the angular velocity within a tick are those of impacts; in hard pushes 0.9."""
_GYRO_RATIO = 4.0
"""Largest change of the angular velocity over that of the joints' speeds or of velocity / height; in falls 2.1."""
_FORCE = 60.0
"""m/s2: greater specific forces are those of impacts; in hard pushes 58."""
_IMPACT_RATIO = 0.35
"""Least change of the joints' speeds, or of the angular velocity, over that of velocity / height; in impacts 0.7."""
_TORQUE = 3.0
"""Largest torque over the joint's limit."""
MOST_FAULTS = 5
"""Consecutive readings after which a value that is finite is believed all the same."""
_QUIET_S = 1.0


class MeasurementMonitor:
    """Finds readings that cannot be true and replaces them.

    Joint angles and speeds are two measurements of one motion: of an angle and a speed that contradict each other, the
    one that contradicts the last speed as well is replaced, an angle by the integral of the speed, a speed by the
    difference of the angles. Angular velocity and specific force change by more than in a push only in impacts, which
    change both, or the speeds of most joints; where they do not, the last value is kept. Values that persist are
    believed; those that are not finite are replaced for as long, and left to the estimator afterwards.

    Args:
        robot: the controller's model, whose limits of speed and torque apply.
        period: time between two readings, s.

    Attributes:
        faults: bits of the quantities replaced in the last reading, see :data:`QUANTITIES`.
        counts: readings replaced so far, by quantity.
    """

    def __init__(self, robot: Robot, period: float) -> None:
        self._jump, self._torque = _JUMP * robot.velocity_limit, _TORQUE * robot.effort_limit
        self._height, self._period = float(robot.q_reference[2]), period
        self.reset()

    def reset(self) -> None:
        """Begin anew with the next reading."""
        self.faults = 0
        self.counts = dict.fromkeys(QUANTITIES, 0)
        self._last: Measurement | None = None
        self._told = -math.inf
        self._begin_series()

    def _begin_series(self) -> None:
        """Forget how long faults have persisted."""
        self._series = dict.fromkeys(QUANTITIES, 0)
        self._faulty = False

    @np.errstate(over="ignore", invalid="ignore")
    def check(self, reading: Measurement) -> Measurement:
        """Return the reading itself if all of it can be true, else a copy with some quantities replaced."""
        last, self.faults = self._last, 0
        checked = reading
        if last is not None:
            period = max(reading.time - last.time, 0.1 * self._period)
            step = reading.speeds - last.speeds
            rate = (reading.joints - last.joints) / period - last.speeds
            turn = reading.gyro - last.gyro
            # Norms are fast, and where those of the shares of the limits are below 1, so is every share.
            plain = (
                math.hypot(*(step / self._jump).tolist(), *(rate / self._jump).tolist()) <= 1.0
                and math.hypot(*(reading.torques / self._torque).tolist()) <= 1.0
                and math.hypot(*reading.accelerometer.tolist()) <= _FORCE
                and math.hypot(*turn.tolist()) <= _GYRO_JUMP
            )
            if not plain:
                checked = self._replaced(reading, last, period, step, rate)
                if not _finite(checked):
                    self._last = last._replace(time=reading.time)
                    return checked
            elif self._faulty:
                self._begin_series()
        self._last = checked
        return checked

    def _replaced(
        self, reading: Measurement, last: Measurement, period: float, step: Array, rate: Array
    ) -> Measurement:
        """Return the reading with what cannot be true replaced.

        Args:
            reading: as measured.
            last: the one before, as it was used.
            period: between them, s.
            step: (nu,) change of the measured speeds, rad/s.
            rate: (nu,) difference of the joint angles over the period, without the last speeds, rad/s.
        """
        jump = self._jump
        apart = ~(np.abs(step - rate) <= jump)  # also where it is NaN
        angles = self._counted("joints", apart & ~(np.abs(rate) <= jump))
        speeds = self._counted("speeds", apart & ~(np.abs(step) <= jump))
        own = np.where(speeds & ~angles, last.speeds + rate, np.where(speeds, last.speeds, reading.speeds))
        joints = np.where(angles, last.joints + period * own, reading.joints)
        change = np.nan_to_num(float(np.median(np.abs(own - last.speeds))))
        torques = self._counted("torques", ~(np.abs(reading.torques) <= self._torque))
        turn = math.hypot(*(reading.gyro - last.gyro).tolist())
        force = math.hypot(*reading.accelerometer.tolist())
        swing = force * period / self._height  # angular velocity of the robot's height at the change of velocity
        gyro = self._counted("gyro", np.array(not turn <= max(_GYRO_JUMP, _GYRO_RATIO * max(change, swing))))
        moved = max(change, 0.0 if gyro else turn)
        blow = not (force <= _FORCE or _IMPACT_RATIO * swing <= moved)
        accelerometer = self._counted("accelerometer", np.array(blow))
        if not self.faults:
            return reading
        self._tell(reading.time, "it is replaced")
        return reading._replace(
            gyro=np.where(gyro, last.gyro, reading.gyro),
            accelerometer=np.where(accelerometer, last.accelerometer, reading.accelerometer),
            joints=joints,
            speeds=own,
            torques=np.where(torques, last.torques, reading.torques),
        )

    def leave_out(self, name: str, time: float) -> None:
        """Count a quantity of the last reading, of ``time`` (s), that the estimator found not to be true."""
        self.faults |= 1 << QUANTITIES.index(name)
        self.counts[name] += 1
        self._tell(time, "it is left out")

    def _tell(self, time: float, response: str) -> None:
        if time - self._told > _QUIET_S:
            self._told = time
            names = " and ".join(name for bit, name in enumerate(QUANTITIES) if self.faults & 1 << bit)
            _LOG.warning("a reading of %s at %.3f s cannot be true: %s", names, time, response)

    def _counted(self, name: str, wrong: BoolArray) -> BoolArray:
        """Return which elements are replaced: those that are wrong, but for a fault that persists."""
        if not wrong.any():
            self._series[name] = 0
            return wrong
        self._series[name] += 1
        self._faulty = True
        if self._series[name] > MOST_FAULTS:
            return np.zeros_like(wrong)
        self.faults |= 1 << QUANTITIES.index(name)
        self.counts[name] += 1
        return wrong


def _finite(reading: Measurement) -> bool:
    return all(np.isfinite(each).all() for each in reading[1:6])
