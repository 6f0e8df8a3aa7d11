"""Errors of the state estimate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lgmpc.lie import attitude, so3
from lgmpc.runs.log import SENSOR_FAULTS, RunLog
from lgmpc.typing import Array

__all__ = ["EstimatorErrors", "SensorFaults", "estimator_errors", "tilt_and_yaw_deg"]


@dataclass(frozen=True)
class EstimatorErrors:
    """Errors of the estimate over a run.

    Position and yaw are not observable by the robot's own sensors: their errors are drift.

    Attributes:
        max_position_m: largest distance between estimated and true base position.
        final_position_m: distance at the end.
        max_tilt_deg: largest angle between estimated and true vertical in the base.
        max_yaw_deg: largest absolute error of the yaw.
        final_yaw_deg: absolute error of the yaw at the end.
        rms_velocity_m_s: RMS norm of the error of the base's linear velocity, base axes.
        max_velocity_m_s: largest norm of this error.
        wrong_contact_fraction: fraction of feet and ticks whose contact was classified wrongly.
        rejected_measurements: of feet in contact that slid, or had just touched down; None in older runs.
    """

    max_position_m: float
    final_position_m: float
    max_tilt_deg: float
    max_yaw_deg: float
    final_yaw_deg: float
    rms_velocity_m_s: float
    max_velocity_m_s: float
    wrong_contact_fraction: float
    rejected_measurements: int | None = None


@dataclass(frozen=True)
class SensorFaults:
    """Ticks in which a quantity's reading could not be true and was replaced.

    Attributes:
        gyro: of the angular velocity.
        accelerometer: of the specific force.
        joints: of a joint angle.
        speeds: of a joint's speed.
        torques: of a joint torque.
    """

    gyro: int
    accelerometer: int
    joints: int
    speeds: int
    torques: int

    @classmethod
    def of(cls, log: RunLog) -> SensorFaults | None:
        """Return the counts of a log; None where measurements were not monitored."""
        if log.sensor_faults is None:
            return None
        bits = {name: 1 << bit for bit, name in enumerate(SENSOR_FAULTS)}
        return cls(**{name: int(np.count_nonzero(log.sensor_faults & bit)) for name, bit in bits.items()})


def estimator_errors(log: RunLog) -> EstimatorErrors | None:
    """Return the errors of a log; ``None`` if there was no finite estimate."""
    if log.estimate_q is None or log.estimate_v is None or log.estimate_contacts is None:
        return None
    use = np.flatnonzero(np.isfinite(log.estimate_q).all(axis=1) & np.isfinite(log.estimate_v).all(axis=1))
    if use.size == 0:
        return None
    position = np.linalg.norm(log.estimate_q[use, :3] - log.q[use, :3], axis=1)
    tilt, yaw = tilt_and_yaw_deg(log.estimate_q[use, 3:7], log.q[use, 3:7])
    velocity = np.linalg.norm(log.estimate_v[use, :3] - log.v[use, :3], axis=1)
    return EstimatorErrors(
        max_position_m=float(position.max()),
        final_position_m=float(position[-1]),
        max_tilt_deg=float(tilt.max()),
        max_yaw_deg=float(np.abs(yaw).max()),
        final_yaw_deg=float(abs(yaw[-1])),
        rms_velocity_m_s=float(np.sqrt(np.mean(np.square(velocity)))),
        max_velocity_m_s=float(velocity.max()),
        wrong_contact_fraction=float((log.closed[use] != (log.estimate_contacts[use] != 0)).mean()),
        rejected_measurements=int(np.count_nonzero(log.estimate_contacts == 2)),
    )


def tilt_and_yaw_deg(estimate: Array, truth: Array) -> tuple[Array, Array]:
    """Decompose the rotation from true to estimated orientations into tilt and yaw.

    Args:
        estimate: (n, 4) quaternions x y z w.
        truth: (n, 4).

    Returns:
        (n,) tilts in [0, 180] and (n,) yaws in [-180, 180], degrees: the rotation is the tilt after the yaw.
    """
    one, other = so3.from_quaternion.unchecked(estimate), so3.from_quaternion.unchecked(truth)
    tilt, yaw = attitude.tilt_and_yaw(one @ np.swapaxes(other, -1, -2))
    return np.degrees(tilt), np.degrees(yaw)
