"""All settings of locomotion, and the gaits of a robot."""

import math

from pydantic import model_validator
from typing_extensions import Self

from lgmpc.errors import InputError
from lgmpc.locomotion.clock import GaitClockSettings
from lgmpc.locomotion.command import CommandLimits
from lgmpc.locomotion.contacts import ContactEventSettings
from lgmpc.locomotion.footholds import FootholdSettings
from lgmpc.locomotion.gait import Gait, biped_gaits, find_gait, quadruped_gaits
from lgmpc.locomotion.legs import LegGeometry
from lgmpc.locomotion.reaction import StepReactionSettings
from lgmpc.locomotion.reference import ReferenceSettings
from lgmpc.locomotion.swing import SwingSettings
from lgmpc.locomotion.terrain import TerrainBeliefSettings
from lgmpc.robot import Robot
from lgmpc.settings import Problem, Settings, key, problems


class LocomotionSettings(Settings):
    """Locomotion of a legged robot: gaits, footholds, swings, contact events, and limits of commands."""

    gaits: tuple[Gait, ...] = key((), "Gaits beside stand, walk, trot, pace, bound and pronk, or in place of them.")
    clock: GaitClockSettings = key(GaitClockSettings(), "Gait transitions.")
    footholds: FootholdSettings = key(FootholdSettings(), "Footholds.")
    swing: SwingSettings = key(SwingSettings(), "Swing trajectories of the feet.")
    contacts: ContactEventSettings = key(ContactEventSettings(), "When a measured contact overrides the schedule.")
    terrain: TerrainBeliefSettings = key(TerrainBeliefSettings(), "Conclusions about the ground from footholds.")
    reference: ReferenceSettings = key(ReferenceSettings(), "Integration of commands.")
    reaction: StepReactionSettings = key(StepReactionSettings(), "Steps of a standing robot against pushes.")
    limits: CommandLimits = key(CommandLimits(), "Limits of commands and of their rates.")

    @model_validator(mode="after")
    def _distinct_names(self) -> Self:
        names = [gait.name for gait in self.gaits]
        found = [
            Problem(f"gaits.{i}.name", name, "a name of its own for each gait")
            for i, name in enumerate(names)
            if name in names[:i]
        ]
        if found:
            raise problems(found)
        return self


def gaits_of(robot: Robot, settings: LocomotionSettings) -> dict[str, Gait]:
    """Return the gaits that commands can select, by name: the predefined ones for this robot's height, and the user's.

    Feet of a quadruped are sorted by position: front left, front right, hind left, hind right; two feet left, right. A
    robot with another number of feet has only the gait stand and the user's gaits.

    Raises:
        InputError: a user's gait of another number of feet, or steps against pushes with a gait that does not exist.
    """
    gaits = {"stand": Gait(name="stand", period_s=1.0, duty=1.0, offsets=(0.0,) * robot.nf)}
    if robot.nf == 4:
        legs = LegGeometry.of(robot)
        order = sorted(range(4), key=lambda foot: (-math.copysign(1.0, legs.feet[foot, 0]), -legs.feet[foot, 1]))
        place = [order.index(foot) for foot in range(4)]
        gaits |= {name: gait.reordered(place) for name, gait in quadruped_gaits(legs.height).items()}
    elif robot.nf == 2:
        legs = LegGeometry.of(robot)
        place = [0, 1] if legs.feet[0, 1] > legs.feet[1, 1] else [1, 0]
        gaits |= {name: gait.reordered(place) for name, gait in biped_gaits(legs.height).items()}
    for i, gait in enumerate(settings.gaits):
        if gait.nc != robot.nf:
            raise InputError(f"locomotion.gaits.{i}.offsets", f"{gait.nc} offsets", f"{robot.nf}, one for each foot")
        gaits[gait.name] = gait
    if settings.reaction.enabled:
        find_gait(gaits, settings.reaction.gait, "locomotion.reaction.gait")
    return gaits
