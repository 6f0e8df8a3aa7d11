"""Config section ``wbc``: the whole-body controller that turns tasks and forces into joint torques."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from lgmpc.settings import Count, NonNegative, Positive, RangeFromZero, Settings, Vector3

__all__ = ["WbcGain", "WbcGains", "WbcSection", "WbcWeights"]


class WbcGain(Settings):
    """Feedback of a task: acceleration = kp (target - position) + kd (target rate - rate)."""

    kp: NonNegative = Field(description="Stiffness, 1/s2.")
    kd: NonNegative | None = Field(default=None, description="Damping, 1/s. null: critical, 2 sqrt(kp).")


class WbcWeights(Settings):
    """Weights of the tasks' squared errors in the quadratic programme; 0 leaves a task out.

    Those of momenta and forces are for a robot of 2.5 kg: a heavier one's are divided by the square of its mass ratio.
    """

    com: Vector3 = Field(default=(10.0, 10.0, 10.0), description="Acceleration of the centre of mass [x, y, z].")
    base_orientation: NonNegative = Field(default=0.1, description="Angular acceleration of the base.")
    base_position: NonNegative = Field(default=0.0, description="Linear acceleration of the base.")
    angular_momentum: NonNegative = Field(default=100.0, description="Rate of the angular momentum (scaled by mass).")
    posture: NonNegative = Field(default=1e-3, description="Joint accelerations towards the reference posture.")
    stance: NonNegative = Field(default=1e3, description="Acceleration of the feet in contact, which should not move.")
    swing: NonNegative = Field(default=10.0, description="Acceleration of the feet in the air.")
    force: NonNegative = Field(default=1e-4, description="Contact forces, towards those of the MPC (scaled by mass).")
    acceleration: NonNegative = Field(default=1e-6, description="All accelerations (keeps the problem well posed).")


class WbcGains(Settings):
    """Feedback gains of the tasks."""

    com: WbcGain = Field(default=WbcGain(kp=100.0), description="Centre of mass.")
    base_orientation: WbcGain = Field(default=WbcGain(kp=400.0), description="Orientation of the base.")
    base_position: WbcGain = Field(default=WbcGain(kp=100.0), description="Position of the base.")
    angular_momentum: NonNegative = Field(default=10.0, description="Centroidal angular momentum, 1/s.")
    posture: WbcGain = Field(default=WbcGain(kp=100.0), description="Joint positions.")
    stance_damping: NonNegative = Field(default=20.0, description="Velocity of the feet in contact, 1/s.")
    swing: WbcGain = Field(default=WbcGain(kp=400.0), description="Feet in the air.")


class WbcSection(Settings):
    """Whole-body quadratic programme over accelerations and contact forces."""

    rate_hz: Positive = Field(default=1000.0, description="Ticks per second, Hz.")
    friction: Positive = Field(default=0.6, description="Friction coefficient that the controller relies on.")
    friction_facets: Annotated[int, Field(strict=True, ge=3, le=32)] = Field(
        default=12, description="Sides of the pyramid inscribed in the friction cone, 3 to 32."
    )
    normal_force_n: RangeFromZero | None = Field(
        default=None,
        description="[lowest, highest] normal force of a foot in contact, N. null: 0.04 and 10 a kg of robot.",
    )
    joint_horizon_s: Positive = Field(
        default=0.05, description="Time ahead within which no joint may pass its position or velocity limit, s."
    )
    joint_acceleration_max_rad_s2: Positive = Field(
        default=2000.0, description="Largest acceleration that the joint limits may ask for, rad/s2."
    )
    weights: WbcWeights = Field(default=WbcWeights(), description="Weights of the tasks.")
    gains: WbcGains = Field(default=WbcGains(), description="Gains of the tasks.")
    tolerance: Positive = Field(default=1e-5, description="Residual at which the solver stops.")
    max_iterations: Count = Field(default=50, description="Most iterations of the solver per tick.")
    fallback_damping_nms: NonNegative = Field(
        default=0.1, description="Joint damping added to the last command when the solver failed, N.m.s/rad."
    )
