"""The map of the ground that a controller is given: of the simulated world, or a class of one's own."""

from collections.abc import Callable

import numpy as np

from lgmpc.config.extensions import called, load_extension, wrong
from lgmpc.config.schema import Config
from lgmpc.locomotion.legs import LegGeometry
from lgmpc.locomotion.maps import ElevationMap, KnownMap, KnownMapSettings, NoMap, OwnMapSettings, SeenMap
from lgmpc.robot import Robot
from lgmpc.simulation.scan import DepthScan
from lgmpc.typing import Array
from lgmpc.world import World

_KEY = "locomotion.terrain.map"
_STREAM = 5
"""Number of the random stream of a map's errors."""
_RANGE, _ABOVE = 5.0, 0.5  # in heights of the centre of mass


def build_map(
    config: Config, robot: Robot, world: World | None = None, pose: Callable[[], Array] | None = None
) -> ElevationMap | None:
    """Return the map of key ``locomotion.terrain.map``, or None.

    Args:
        config: the closed loop.
        robot: the controller's model.
        world: of the simulated robot, if it is one.
        pose: returns the true pose (7,) of its base.

    Raises:
        ConfigError: one's own class cannot be used, or a map of the simulated world on a robot.
    """
    settings = config.locomotion.terrain.map
    if isinstance(settings, NoMap):
        return None
    if isinstance(settings, OwnMapSettings):
        found = called(config, _KEY, settings, load_extension(config, _KEY, settings.use))
        if not isinstance(found, ElevationMap):
            raise wrong(config, _KEY, settings, found, "an object with update, height and steppable")
        return found
    if world is None or pose is None:
        raise config.error(f"{_KEY}.kind", f"'{settings.kind}' without a simulated world", "'none' or 'own'")
    height = LegGeometry.of(robot).height
    rng = np.random.default_rng((config.seed if settings.seed is None else settings.seed, _STREAM))
    if isinstance(settings, KnownMapSettings):
        return KnownMap(world.height, settings, height, rng)
    reach = _RANGE * height if settings.range_m is None else settings.range_m
    above = _ABOVE * height if settings.above_m is None else settings.above_m
    seen = SeenMap(lambda: scan(), settings, height)
    scan = DepthScan(world.height, pose, reach, seen.cell, above, settings.noise_m, rng)
    return seen
