"""Settings of gaits and jumps, with dimensionless weights."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from lgmpc.errors import InputError
from lgmpc.locomotion.sequence import GaitPhase, GaitSequence, QuadrupedFeet
from lgmpc.problems.scenario import ProblemSettings
from lgmpc.robot import Robot
from lgmpc.settings import (
    Count,
    Finite,
    Fraction,
    Friction,
    Interval,
    NonNegative,
    Positive,
    Settings,
    Vector2,
    Vector3,
    problem,
)
from lgmpc.typing import Array
from lgmpc.world import FloorSettings, World, WorldSettings, make_world

ContactGains = Annotated[
    dict[str, tuple[NonNegative, NonNegative]],
    Field(
        description="Baumgarte's [stiffness, damping] of single contacts, {frame: [1/s2, 1/s]}; those of others follow "
        "from the interval's length."
    ),
]

_PATTERNS = {
    "walk": GaitSequence.walk,
    "trot": GaitSequence.trot,
    "pace": GaitSequence.pace,
    "bound": GaitSequence.bound,
}


class LeggedWeights(Settings):
    """Dimensionless weights of squared deviations, in units of the robot's mass, leg length and gravity.

    The same values serve robots of all sizes. The unit of time of the running cost is sqrt(length / g).
    """

    position: NonNegative = Field(default=0.1, description="Horizontal position of the base from the commanded one.")
    height: NonNegative = Field(default=10.0, description="Height of the base.")
    rotation: NonNegative = Field(default=10.0, description="Rotation of the base.")
    joints: NonNegative = Field(default=0.3, description="Joints from the reference posture.")
    velocity: NonNegative = Field(default=1.0, description="Velocity of the base, linear and angular.")
    joint_velocity: NonNegative = Field(default=0.01, description="Joint speeds.")
    effort: Positive = Field(default=2.0, description="Torques from those that carry the robot at rest.")
    swing: NonNegative = Field(default=1e4, description="Feet in the air from their references.")
    friction: NonNegative = Field(default=1e3, description="Contact forces and impulses outside their cone.")
    limits: NonNegative = Field(default=1e3, description="Joint positions and speeds beyond their limits.")
    foothold: NonNegative = Field(default=1e5, description="Feet from their footholds, at touchdowns.")
    touchdown: NonNegative = Field(default=1e3, description="Speeds of the feet at touchdowns.")
    clearance: NonNegative = Field(
        default=1e4, description="Trunk, knees and shanks nearer to the ground than clearance_m; feet in the air in it."
    )
    terminal: NonNegative = Field(default=100.0, description="Factor of the state's weights at the end.")


class JumpWeights(LeggedWeights):
    """Weights as those of a gait, with other defaults: small before the landing, large at it and at the end."""

    height: NonNegative = Field(default=1.0, description="Height of the base.")
    rotation: NonNegative = Field(default=1.0, description="Rotation of the base.")
    effort: Positive = Field(default=0.2, description="Torques from those that carry the robot at rest.")
    swing: NonNegative = Field(default=100.0, description="Feet in the air from their references.")
    touchdown: NonNegative = Field(default=10.0, description="Speeds of the feet at touchdowns.")


class LeggedSettings(Settings):
    """The common settings of gaits and jumps."""

    step_s: Interval = Field(
        default=0.015, description="Approximate length of an interval, s; intervals end at switches."
    )
    friction: Friction = Field(default=0.7, description="Friction coefficient of the ground.")
    friction_margin: Annotated[Fraction, Field(lt=1.0)] = Field(
        default=0.1, description="The cost penalises contact forces above (1 - friction_margin) of the friction limit."
    )
    effort_margin: Annotated[Fraction, Field(lt=1.0)] = Field(
        default=0.0, description="Share of the torque limits that the plan leaves to the feedback of who performs it."
    )
    joint_margin_rad: NonNegative = Field(
        default=0.0, description="Distance from the joints' limits within which a cost acts, rad."
    )
    least_force: Annotated[NonNegative, Field(lt=0.25)] = Field(
        default=0.05,
        description="Normal force of feet on the ground below which a cost acts, as a fraction of the robot's weight.",
    )
    clearance_m: NonNegative = Field(
        default=0.01,
        description="Distance of trunk and knees from the ground below which a cost acts, m; of feet in the middle of "
        "their swings too.",
    )
    world: WorldSettings = Field(
        default=FloorSettings(),
        description="The ground, of planes and boxes, where the robot starts on it. A motion performed as a "
        "manoeuvre has the world of its closed loop.",
    )
    contact_gains: ContactGains = {}
    weights: LeggedWeights = Field(default=LeggedWeights(), description="Weights of the cost.")

    def ground(self) -> World:
        """Return the world of the settings."""
        return make_world(self.world, self.friction)


class GaitSettings(LeggedSettings, ProblemSettings):
    """A robot stands, walks for some cycles at a commanded velocity, and stands."""

    kind: Literal["gait"] = Field(default="gait", description="A robot walks, trots, ... in a gait.")
    pattern: Literal["walk", "trot", "pace", "bound"] | None = Field(
        default=None, description="A quadruped's gait. Give this or phases."
    )
    phases: tuple[GaitPhase, ...] = Field(
        default=(), description="One cycle, phase by phase, of any robot with point feet. Give this or pattern."
    )
    cycles: Annotated[Count, Field(le=100)] = Field(default=3, description="Number of cycles, at most 100.")
    swing_s: Positive = Field(default=0.2, description="Duration of a swing, s (of a pattern).")
    stance_s: NonNegative = Field(
        default=0.04, description="Time with all feet on the ground after each swing, s (of a pattern)."
    )
    height_m: NonNegative = Field(default=0.05, description="Apex of the swings, m (of a pattern).")
    velocity_m_s: Vector2 = Field(default=(0.3, 0.0), description="[ahead, left] in the base's axes, m/s.")
    yaw_rate_deg_s: Finite = Field(default=0.0, description="Rate of turning to the left, degrees per s.")
    settle_s: Positive = Field(default=0.2, description="Time of standing before and after, s.")
    ramp_s: NonNegative = Field(default=0.2, description="Time of acceleration and of deceleration of the base, s.")

    @model_validator(mode="after")
    def _one_gait(self) -> GaitSettings:
        if self.pattern is None and not self.phases:
            raise problem("walk, trot, pace or bound here, or a cycle in the key phases", key="pattern", got=None)
        if self.pattern is not None and self.phases:
            raise problem(f"nothing here, because pattern is given ({self.pattern})", key="phases", got=self.phases)
        return self

    def gait(self, robot: Robot) -> GaitSequence:
        """Return the gait of a robot's feet.

        Raises:
            InputError: a named pattern for a robot that is no quadruped, or phases with unknown feet.
        """
        feet = robot.contact_frames
        still = GaitSequence.stand(feet, self.settle_s)
        if self.pattern is None:
            cycle = GaitSequence(feet, self.phases)
        else:
            cycle = _PATTERNS[self.pattern](feet, QuadrupedFeet.of(robot), self.swing_s, self.stance_s, self.height_m)
        return still + self.cycles * cycle + still


class JumpSettings(LeggedSettings, ProblemSettings):
    """A robot crouches, takes off with all feet, flies, lands on all feet, and comes to rest."""

    kind: Literal["jump"] = Field(default="jump", description="A robot jumps.")
    displacement_m: Vector3 = Field(
        default=(0.2, 0.0, 0.0),
        description="Displacement at the landing, [ahead, left, up], m; up from the height of the "
        "world's ground there.",
    )
    yaw_deg: Finite = Field(default=0.0, description="Angle by which it turns to the left in the air, degrees.")
    takeoff_s: Positive = Field(default=0.3, description="Time on the ground before the flight, s.")
    flight_s: Positive = Field(default=0.3, description="Duration of the flight, s.")
    landing_s: Positive = Field(default=0.5, description="Time on the ground after the landing, s.")
    height_m: NonNegative = Field(default=0.1, description="Apex of the feet's paths above the straight line, m.")
    step_s: Interval = Field(
        default=0.01, description="Approximate length of an interval, s; intervals end at switches."
    )
    weights: JumpWeights = Field(default=JumpWeights(), description="Weights of the cost.")

    def gait(self, robot: Robot) -> GaitSequence:
        """Return the gait of a robot's feet."""
        return GaitSequence.jump(robot.contact_frames, self.takeoff_s, self.flight_s, self.landing_s, self.height_m)


def gains_of_contacts(robot: Robot, given: Mapping[str, tuple[float, float]], default: Array) -> Array:
    """Return (n, 2 nc) stiffness and damping of each contact of a robot.

    Args:
        robot: with contact frames.
        given: [stiffness, damping] by frame.
        default: (n, 2) of the other contacts, at each of n nodes.

    Raises:
        InputError: a frame that is no contact.
    """
    gains = np.tile(default, (1, robot.nc))
    for name, pair in given.items():
        if name not in robot.contact_frames:
            raise InputError("contact_gains", name, f"a contact frame of {robot.name}", robot.contact_frames)
        start = 2 * robot.contact_frames.index(name)
        gains[:, start : start + 2] = pair
    return gains
