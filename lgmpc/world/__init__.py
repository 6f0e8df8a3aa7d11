"""The surroundings of the robot: surfaces with friction, from settings and seed, and queries of the ground over them.

Only plants, initial states, judging, replay and problems read a :class:`World`; a controller has its
:class:`~lgmpc.estimation.terrain.TerrainBelief` instead.
"""

from lgmpc.world.boxes import Box as Box
from lgmpc.world.heights import HeightField as HeightField
from lgmpc.world.kinds import (
    Blocks as Blocks,
    Gaps as Gaps,
    Heights as Heights,
    Hills as Hills,
    Patches as Patches,
    Ramp as Ramp,
    Stairs as Stairs,
    Stones as Stones,
)
from lgmpc.world.settings import (
    Course as Course,
    FloorSettings as FloorSettings,
    SlopeSettings as SlopeSettings,
    WorldSettings as WorldSettings,
    make_world as make_world,
)
from lgmpc.world.surfaces import Plane as Plane, Softness as Softness, Terrain as Terrain
from lgmpc.world.world import World as World
