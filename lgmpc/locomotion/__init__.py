"""Locomotion of legged robots: motion commands, gaits and their clock, contact events, footholds, swings."""

from lgmpc.locomotion.clock import GaitClock, GaitClockSettings, SwingInterval
from lgmpc.locomotion.command import (
    CommandEntry,
    CommandFunction,
    CommandLimiter,
    CommandLimits,
    CommandSource,
    CommandTimeline,
    MotionCommand,
    Timeline,
)
from lgmpc.locomotion.contacts import ContactEvents, ContactEventSettings, ContactState
from lgmpc.locomotion.footholds import BaseMotion, FootholdPlanner, FootholdSettings
from lgmpc.locomotion.gait import Gait, find_gait, quadruped_gaits
from lgmpc.locomotion.horizon import ContactHorizon, MotionReference
from lgmpc.locomotion.legs import LegGeometry
from lgmpc.locomotion.maps import ElevationMap, GridMap
from lgmpc.locomotion.reference import ReferenceBuilder, ReferenceSettings
from lgmpc.locomotion.swing import SwingSettings, SwingTrajectory
from lgmpc.locomotion.terrain import TerrainBelief, TerrainBeliefSettings

__all__ = [
    "BaseMotion",
    "CommandEntry",
    "CommandFunction",
    "CommandLimiter",
    "CommandLimits",
    "CommandSource",
    "CommandTimeline",
    "ContactEventSettings",
    "ContactEvents",
    "ContactHorizon",
    "ContactState",
    "ElevationMap",
    "FootholdPlanner",
    "FootholdSettings",
    "Gait",
    "GaitClock",
    "GaitClockSettings",
    "GridMap",
    "LegGeometry",
    "MotionCommand",
    "MotionReference",
    "ReferenceBuilder",
    "ReferenceSettings",
    "SwingInterval",
    "SwingSettings",
    "SwingTrajectory",
    "TerrainBelief",
    "TerrainBeliefSettings",
    "Timeline",
    "find_gait",
    "quadruped_gaits",
]
