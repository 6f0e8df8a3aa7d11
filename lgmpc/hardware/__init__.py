"""Robots outside this process: the driver interface, the real-time loop of a controller, a link over UDP.

A driver of real hardware implements :class:`Driver` and requires :mod:`lgmpc.control.interface` only.
"""

from lgmpc.hardware.deployment import (
    DeployedTick as DeployedTick,
    Deployment as Deployment,
    Driver as Driver,
    StopReason as StopReason,
    deploy as deploy,
)
from lgmpc.hardware.safety import (
    DeploymentSettings as DeploymentSettings,
    JointLimits as JointLimits,
    Operator as Operator,
)
from lgmpc.hardware.udp import UdpDriver as UdpDriver, UdpRobot as UdpRobot
