"""Settings of gaits and jumps, with dimensionless weights."""

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
    key,
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

    position: NonNegative = key(0.1, "Horizontal position of the base from the commanded one.")
    height: NonNegative = key(10.0, "Height of the base.")
    rotation: NonNegative = key(10.0, "Rotation of the base.")
    joints: NonNegative = key(0.3, "Joints from the reference posture.")
    velocity: NonNegative = key(1.0, "Velocity of the base, linear and angular.")
    joint_velocity: NonNegative = key(0.01, "Joint speeds.")
    effort: Positive = key(2.0, "Torques from those that carry the robot at rest.")
    swing: NonNegative = key(1e4, "Feet in the air from their references.")
    friction: NonNegative = key(1e3, "Contact forces and impulses outside their cone.")
    limits: NonNegative = key(1e3, "Joint positions and speeds beyond their limits.")
    foothold: NonNegative = key(1e5, "Feet from their footholds, at touchdowns.")
    touchdown: NonNegative = key(1e3, "Speeds of the feet at touchdowns.")
    clearance: NonNegative = key(1e4, "Trunk, knees, shanks nearer to the ground than clearance_m; swing feet in it.")
    terminal: NonNegative = key(100.0, "Factor of the state's weights at the end.")


class JumpWeights(LeggedWeights):
    """Weights as those of a gait, with other defaults: small before the landing, large at it and at the end."""

    height: NonNegative = key(1.0, "Height of the base.")
    rotation: NonNegative = key(1.0, "Rotation of the base.")
    effort: Positive = key(0.2, "Torques from those that carry the robot at rest.")
    swing: NonNegative = key(100.0, "Feet in the air from their references.")
    touchdown: NonNegative = key(10.0, "Speeds of the feet at touchdowns.")


class LeggedSettings(Settings):
    """The common settings of gaits and jumps."""

    step_s: Interval = key(0.015, "Approximate length of an interval, s; intervals end at switches.")
    friction: Friction = key(0.7, "Friction coefficient of the ground.")
    friction_margin: Annotated[Fraction, Field(lt=1.0)] = key(
        0.1, "The cost penalises contact forces above (1 - friction_margin) of the friction limit."
    )
    effort_margin: Annotated[Fraction, Field(lt=1.0)] = key(
        0.0, "Share of the torque limits that the plan leaves to the feedback of who performs it."
    )
    joint_margin_rad: NonNegative = key(0.0, "Distance from the joints' limits within which a cost acts, rad.")
    least_force: Annotated[NonNegative, Field(lt=0.25)] = key(
        0.05, "Normal force of feet on the ground below which a cost acts, as a fraction of the robot's weight."
    )
    clearance_m: NonNegative = key(
        0.01,
        "Distance of trunk and knees from the ground below which a cost acts, m; of feet in the middle of "
        "their swings too.",
    )
    world: WorldSettings = key(
        FloorSettings(),
        "The ground, of planes and boxes, where the robot starts on it. A motion performed as a "
        "manoeuvre has the world of its closed loop.",
    )
    contact_gains: ContactGains = {}
    weights: LeggedWeights = key(LeggedWeights(), "Weights of the cost.")

    def ground(self) -> World:
        """Return the world of the settings."""
        return make_world(self.world, self.friction)


class GaitSettings(LeggedSettings, ProblemSettings):
    """A robot stands, walks for some cycles at a commanded velocity, and stands."""

    kind: Literal["gait"] = key("gait", "A robot walks, trots, ... in a gait.")
    pattern: Literal["walk", "trot", "pace", "bound"] | None = key(None, "A quadruped's gait. Give this or phases.")
    phases: tuple[GaitPhase, ...] = key((), "One cycle, phase by phase, of any robot with point feet; or pattern.")
    cycles: Annotated[Count, Field(le=100)] = key(3, "Number of cycles, at most 100.")
    swing_s: Positive = key(0.2, "Duration of a swing, s (of a pattern).")
    stance_s: NonNegative = key(0.04, "Time with all feet on the ground after each swing, s (of a pattern).")
    height_m: NonNegative = key(0.05, "Apex of the swings, m (of a pattern).")
    velocity_m_s: Vector2 = key((0.3, 0.0), "[ahead, left] in the base's axes, m/s.")
    yaw_rate_deg_s: Finite = key(0.0, "Rate of turning to the left, degrees per s.")
    settle_s: Positive = key(0.2, "Time of standing before and after, s.")
    ramp_s: NonNegative = key(0.2, "Time of acceleration and of deceleration of the base, s.")

    @model_validator(mode="after")
    def _one_gait(self) -> "GaitSettings":
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

    kind: Literal["jump"] = key("jump", "A robot jumps.")
    displacement_m: Vector3 = key(
        (0.2, 0.0, 0.0),
        "Displacement at the landing, [ahead, left, up], m; up from the height of the world's ground there.",
    )
    yaw_deg: Finite = key(0.0, "Angle by which it turns to the left in the air, degrees.")
    takeoff_s: Positive = key(0.3, "Time on the ground before the flight, s.")
    flight_s: Positive = key(0.3, "Duration of the flight, s.")
    landing_s: Positive = key(0.5, "Time on the ground after the landing, s.")
    height_m: NonNegative = key(0.1, "Apex of the feet's paths above the straight line, m.")
    step_s: Interval = key(0.01, "Approximate length of an interval, s; intervals end at switches.")
    weights: JumpWeights = key(JumpWeights(), "Weights of the cost.")

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
