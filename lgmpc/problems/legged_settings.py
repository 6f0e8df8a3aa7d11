"""What can be said about walking and jumping robots: gaits, jumps, and weights without dimension."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

from lgmpc.errors import InputError
from lgmpc.locomotion.sequence import GaitPhase, QuadrupedFeet
from lgmpc.locomotion.sequence import GaitSequence as Gait
from lgmpc.robot import Robot

__all__ = ["GaitSettings", "JumpSettings", "LeggedSettings", "LeggedWeights"]

_PATTERNS = {"walk": Gait.walk, "trot": Gait.trot, "pace": Gait.pace, "bound": Gait.bound}


def _check(name: str, value: float, fits: bool, expected: str) -> None:
    if not (math.isfinite(value) and fits):
        raise InputError(name, value, expected)


@dataclass(frozen=True)
class LeggedWeights:
    """Weights of squared deviations, without dimension: a robot's mass, leg length and weight are the units.

    So they mean the same to robots of all sizes. The running cost counts per sqrt(length / g), the time in which a
    pendulum as long as the legs swings by a radian.

    Attributes:
        position: of the base, ahead and to the left, from where it is commanded to be.
        height: of the base.
        rotation: of the base.
        joints: of the joints from the reference posture.
        velocity: of the base, linear and angular, from what is commanded.
        joint_velocity: of the joints.
        effort: of the torques from those that carry the robot at rest.
        swing: of the feet in the air from their references.
        friction: on forces outside their cone, and on such impulses.
        limits: on joint positions and speeds beyond their limits.
        foothold: on the places where feet come down, once each.
        touchdown: on the speeds at which they do, once each.
        terminal: factor of the state's weights at the end, where they count once.

    Raises:
        InputError: a weight that is negative or not finite.
    """

    position: float = 0.1
    height: float = 10.0
    rotation: float = 10.0
    joints: float = 0.3
    velocity: float = 1.0
    joint_velocity: float = 0.01
    effort: float = 2.0
    swing: float = 1e4
    friction: float = 1e3
    limits: float = 1e3
    foothold: float = 1e5
    touchdown: float = 1e3
    terminal: float = 100.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            _check(f"weights.{name}", value, 0.0 <= value, "at least 0")

    @classmethod
    def jumping(cls) -> LeggedWeights:
        """The weights for jumps: little on the way, which torques decide, all on the landing and the end."""
        return cls(height=1.0, rotation=1.0, effort=0.2, swing=100.0, touchdown=10.0)


@dataclass(frozen=True)
class LeggedSettings:
    """What all legged problems have in common.

    Attributes:
        step: about the length of an interval, s.
        friction: coefficient of the ground.
        friction_margin: fraction of it that forces are drawn away from.
        least_force: normal force that feet on the ground are drawn above, as a fraction of the robot's weight.
        weights: of the costs.

    Raises:
        InputError: a number out of its range.
    """

    step: float = 0.015
    friction: float = 0.7
    friction_margin: float = 0.1
    least_force: float = 0.05
    weights: LeggedWeights = LeggedWeights()

    def __post_init__(self) -> None:
        _check("step", self.step, 0.0 < self.step, "above 0 s")
        _check("friction", self.friction, 0.0 < self.friction, "above 0")
        _check("friction_margin", self.friction_margin, 0.0 <= self.friction_margin < 1.0, "0 or above, below 1")
        _check("least_force", self.least_force, 0.0 <= self.least_force < 0.25, "0 or above, below a quarter")


@dataclass(frozen=True)
class GaitSettings:
    """A robot that stands, goes for some cycles at a commanded velocity, and stands.

    Attributes:
        pattern: of a quadruped's cycle, or the cycle's phases, for any robot with feet.
        cycles: how many.
        swing: how long a foot is in the air, s (of a named pattern).
        stance: how long all feet are on the ground after each swing, s (of a named pattern).
        height: of the swings, m (of a named pattern).
        velocity: (ahead, left) in the base's axes, m/s.
        yaw_rate: rad/s.
        settle: how long the robot stands before and after, s.
        ramp: how long the base takes to its speed and from it, s.
        common: see there.

    Raises:
        InputError: a number out of its range, or an unknown pattern.
    """

    pattern: Literal["walk", "trot", "pace", "bound"] | tuple[GaitPhase, ...] = "trot"
    cycles: int = 3
    swing: float = 0.2
    stance: float = 0.04
    height: float = 0.05
    velocity: tuple[float, float] = (0.3, 0.0)
    yaw_rate: float = 0.0
    settle: float = 0.2
    ramp: float = 0.2
    common: LeggedSettings = LeggedSettings()

    def __post_init__(self) -> None:
        if isinstance(self.pattern, str) and self.pattern not in _PATTERNS:
            raise InputError("pattern", self.pattern, "a gait's name, or its phases", tuple(_PATTERNS))
        _check("cycles", self.cycles, self.cycles >= 1, "at least 1")
        _check("swing", self.swing, self.swing > 0, "above 0 s")
        _check("stance", self.stance, self.stance >= 0, "at least 0 s")
        _check("height", self.height, self.height >= 0, "at least 0 m")
        _check("settle", self.settle, self.settle > 0, "above 0 s")

    def gait(self, robot: Robot) -> Gait:
        """Return the gait of a robot's feet.

        Raises:
            InputError: a named pattern for a robot that is no quadruped, or phases with feet that it does not have.
        """
        feet = robot.contact_frames
        still = Gait.stand(feet, self.settle)
        if isinstance(self.pattern, str):
            legs = QuadrupedFeet.of(robot)
            cycle = _PATTERNS[self.pattern](feet, legs, self.swing, self.stance, self.height)
        else:
            cycle = Gait(feet, self.pattern)
        return still + self.cycles * cycle + still


@dataclass(frozen=True)
class JumpSettings:
    """A robot that crouches, takes off with all feet, flies, lands on all feet, and comes to rest.

    Attributes:
        displacement: of the landing, (ahead, left, up), m.
        yaw: by which it turns in the air, rad.
        takeoff: how long it stands before the flight, s.
        flight: s; with the rise it says how fast it takes off.
        landing: how long it has to come to rest, s.
        height: by which the feet rise above the straight line, m.
        common: see there.

    Raises:
        InputError: a number out of its range.
    """

    displacement: tuple[float, float, float] = (0.2, 0.0, 0.0)
    yaw: float = 0.0
    takeoff: float = 0.3
    flight: float = 0.3
    landing: float = 0.5
    height: float = 0.1
    common: LeggedSettings = field(default_factory=lambda: LeggedSettings(step=0.01, weights=LeggedWeights.jumping()))

    def __post_init__(self) -> None:
        for name in ("takeoff", "flight", "landing"):
            _check(name, getattr(self, name), getattr(self, name) > 0, "above 0 s")
        _check("height", self.height, self.height >= 0, "at least 0 m")

    def gait(self, robot: Robot) -> Gait:
        """Return the gait of a robot's feet."""
        return Gait.jump(robot.contact_frames, self.takeoff, self.flight, self.landing, self.height)
