"""Locomotion of legged robots: motion commands, gaits and their clock, contact events, footholds, swings."""

from lgmpc.locomotion.clock import (
    GaitClock as GaitClock,
    GaitClockSettings as GaitClockSettings,
    SwingInterval as SwingInterval,
)
from lgmpc.locomotion.command import (
    CommandEntry as CommandEntry,
    CommandFunction as CommandFunction,
    CommandLimiter as CommandLimiter,
    CommandLimits as CommandLimits,
    CommandSource as CommandSource,
    CommandTimeline as CommandTimeline,
    MotionCommand as MotionCommand,
    Timeline as Timeline,
)
from lgmpc.locomotion.contacts import (
    ContactEvents as ContactEvents,
    ContactEventSettings as ContactEventSettings,
    ContactState as ContactState,
)
from lgmpc.locomotion.footholds import (
    BaseMotion as BaseMotion,
    FootholdPlanner as FootholdPlanner,
    FootholdSettings as FootholdSettings,
)
from lgmpc.locomotion.gait import Gait as Gait, find_gait as find_gait, quadruped_gaits as quadruped_gaits
from lgmpc.locomotion.horizon import ContactHorizon as ContactHorizon, MotionReference as MotionReference
from lgmpc.locomotion.legs import LegGeometry as LegGeometry
from lgmpc.locomotion.maps import ElevationMap as ElevationMap, GridMap as GridMap
from lgmpc.locomotion.reference import ReferenceBuilder as ReferenceBuilder, ReferenceSettings as ReferenceSettings
from lgmpc.locomotion.swing import SwingSettings as SwingSettings, SwingTrajectory as SwingTrajectory
from lgmpc.locomotion.terrain import TerrainBelief as TerrainBelief, TerrainBeliefSettings as TerrainBeliefSettings
