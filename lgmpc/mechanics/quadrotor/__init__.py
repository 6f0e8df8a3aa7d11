"""A quadrotor on SE(3): equations of motion, trajectories, and two controllers (chapter 4.12.3).

All functions support leading batch axes: a Monte Carlo study is one simulation.
"""

from lgmpc.mechanics.quadrotor.euler_angles import EulerAnglePid, EulerGains
from lgmpc.mechanics.quadrotor.geometric import AttitudeCommand, GeometricController, GeometricGains, attitude_error
from lgmpc.mechanics.quadrotor.model import Flight, Quadrotor, QuadrotorState, fly
from lgmpc.mechanics.quadrotor.trajectory import FlatOutput, FlatTrajectory, Hover, Lissajous

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
