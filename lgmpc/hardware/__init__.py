"""Robots outside this process: the driver interface, the real-time loop of a controller, a link over UDP.

A driver of real hardware implements :class:`Driver` and requires :mod:`lgmpc.control.interface` only.
"""

from lgmpc.hardware.deployment import DeployedTick, Deployment, DeploymentSettings, Driver, Ending, deploy
from lgmpc.hardware.udp import UdpDriver, UdpRobot

__all__ = ["DeployedTick", "Deployment", "DeploymentSettings", "Driver", "Ending", "UdpDriver", "UdpRobot", "deploy"]
