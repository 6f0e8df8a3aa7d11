"""Controllers composed of the other rooms' parts, and the interface by which a plant or a robot drives them.

Only :mod:`lgmpc.control.interface` is imported with the room: plants and estimators need no controller.
"""

from lgmpc.control.interface import Command, Controller, Estimator, Measurement, RobotState

__all__ = ["Command", "Controller", "Estimator", "Measurement", "RobotState"]
