"""Robots outside this process: the driver interface, the real-time loop of a controller, a link over UDP.

A driver of real hardware implements :class:`Driver` and requires :mod:`lgmpc.control.interface` only.
"""

from lgmpc.hardware.deployment import DeployedTick, Deployment, Driver, Ending, deploy
from lgmpc.hardware.safety import DeploymentSettings, JointLimits, Operator
from lgmpc.hardware.udp import UdpDriver, UdpRobot

__all__ = [
    "DeployedTick",
    "Deployment",
    "DeploymentSettings",
    "Driver",
    "Ending",
    "JointLimits",
    "Operator",
    "UdpDriver",
    "UdpRobot",
    "deploy",
]
