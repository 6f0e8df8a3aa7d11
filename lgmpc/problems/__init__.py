"""Ready-made optimal control problems, each with its guess and what success means."""

from lgmpc.problems.scenario import Controls, Scenario, Waypoint

__all__ = ["Controls", "Scenario", "Waypoint"]
