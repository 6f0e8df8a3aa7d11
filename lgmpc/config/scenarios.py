"""From the config of a problem to solve to its scenario."""

from __future__ import annotations

from lgmpc.config.robots import build_any_robot
from lgmpc.config.schema import SolveConfig
from lgmpc.errors import InputError
from lgmpc.problems import Scenario, build_problem

__all__ = ["build_scenario"]


def build_scenario(config: SolveConfig) -> Scenario:
    """Load the robot and build the problem.

    Raises:
        ConfigError: a robot that does not exist, or a problem that this robot cannot have.
        ModelError: with everything that the model lacks.
    """
    robot = build_any_robot(config)
    try:
        return build_problem(robot, config.problem)
    except InputError as error:
        of_robot = error.argument.partition(".")[0] == "robot"
        key = error.argument if of_robot else f"problem.{error.argument}"
        raise config.error(key, error.got, error.expected, error.choices) from error
