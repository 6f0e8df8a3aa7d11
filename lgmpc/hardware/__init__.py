"""Robots outside this process: a driver's contract, the loop that runs a controller on it in real time, a link by UDP.

A driver of real hardware implements :class:`Driver` and needs :mod:`lgmpc.control.interface` only.
"""

from lgmpc.hardware.deployment import DeployedTick, Deployment, DeploymentSettings, Driver, Ending, deploy
from lgmpc.hardware.udp import UdpDriver, UdpRobot

__all__ = ["DeployedTick", "Deployment", "DeploymentSettings", "Driver", "Ending", "UdpDriver", "UdpRobot", "deploy"]
