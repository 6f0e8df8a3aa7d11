"""A quadrotor on SE(3): equations of motion, trajectories, and two controllers (chapter 4.12.3).

All functions support leading batch axes: a Monte Carlo study is one simulation.
"""

from lgmpc.mechanics.quadrotor.control import (
    AttitudeCommand,
    EulerAnglePid,
    EulerGains,
    GeometricController,
    GeometricGains,
    attitude_error,
)
from lgmpc.mechanics.quadrotor.model import (
    FlatOutput,
    FlatTrajectory,
    Flight,
    Hover,
    Lissajous,
    Quadrotor,
    QuadrotorState,
    fly,
)

__all__ = [
    "AttitudeCommand",
    "EulerAnglePid",
    "EulerGains",
    "FlatOutput",
    "Flight",
    "GeometricController",
    "GeometricGains",
    "Hover",
    "Lissajous",
    "Quadrotor",
    "QuadrotorState",
    "FlatTrajectory",
    "attitude_error",
    "fly",
]
