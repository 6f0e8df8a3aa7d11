"""The surroundings of the robot: surfaces with friction, from settings and seed, and queries of the ground over them.

Only plants, initial states, judging, replay and problems read a :class:`World`; a controller has its
:class:`~lgmpc.estimation.terrain.TerrainBelief` instead.
"""

from lgmpc.world.boxes import Box
from lgmpc.world.heights import HeightField
from lgmpc.world.kinds import Blocks, Gaps, Heights, Hills, Patches, Ramp, Stairs, Stones
from lgmpc.world.settings import Course, FloorSettings, SlopeSettings, WorldSettings, make_world
from lgmpc.world.surfaces import Plane, Softness, Surface, SurfaceContacts
from lgmpc.world.terrain import Terrain
from lgmpc.world.world import World

__all__ = [
    "Blocks",
    "Box",
    "Course",
    "FloorSettings",
    "Gaps",
    "HeightField",
    "Heights",
    "Hills",
    "Patches",
    "Plane",
    "Ramp",
    "SlopeSettings",
    "Softness",
    "Stairs",
    "Stones",
    "Surface",
    "SurfaceContacts",
    "Terrain",
    "World",
    "WorldSettings",
    "make_world",
]
