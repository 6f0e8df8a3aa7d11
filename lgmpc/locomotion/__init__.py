"""Locomotion of legged robots: motion commands, gaits and their clock, contact events, footholds, swings."""

from lgmpc.locomotion.clock import GaitClock as GaitClock
from lgmpc.locomotion.command import (
    CommandFunction as CommandFunction,
    CommandLimiter as CommandLimiter,
    CommandLimits as CommandLimits,
    CommandSource as CommandSource,
    CommandTimeline as CommandTimeline,
    MotionCommand as MotionCommand,
)
from lgmpc.locomotion.contacts import ContactEvents as ContactEvents, ContactState as ContactState
from lgmpc.locomotion.footholds import BaseMotion as BaseMotion, FootholdPlanner as FootholdPlanner
from lgmpc.locomotion.gait import Gait as Gait
from lgmpc.locomotion.horizon import ContactHorizon as ContactHorizon
from lgmpc.locomotion.legs import LegGeometry as LegGeometry
from lgmpc.locomotion.maps import ElevationMap as ElevationMap, GridMap as GridMap
from lgmpc.locomotion.swing import SwingTrajectory as SwingTrajectory
from lgmpc.locomotion.terrain import TerrainBelief as TerrainBelief, TerrainBeliefSettings as TerrainBeliefSettings
