"""A quadrotor on SE(3): its equations, trajectories for it, and two controllers (chapter 4.12.3).

Everything takes leading batch axes, so that a Monte Carlo study over thousands of starts is one simulation.
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
