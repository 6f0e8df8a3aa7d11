"""Controllers composed of the other packages' parts, and their interface to plants and robots.

Only :mod:`lgmpc.control.interface` is imported with the package: plants and estimators require no controller.
"""

from lgmpc.control.interface import (
    Command as Command,
    Controller as Controller,
    Estimator as Estimator,
    Measurement as Measurement,
    RobotState as RobotState,
)
