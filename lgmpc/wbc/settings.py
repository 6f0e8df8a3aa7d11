"""Settings of the whole-body controller: the weights and gains of its tasks, its limits, its solver."""

import math
from itertools import pairwise
from typing import Annotated, Literal

from pydantic import Field, field_validator

from lgmpc.robot import Robot
from lgmpc.robot.friction import chosen_facets
from lgmpc.robot.scaling import normal_force_range, turning_factor, weight_factor
from lgmpc.settings import (
    Count,
    Extension,
    NonNegative,
    Positive,
    Problem,
    RangeFromZero,
    Settings,
    Vector3,
    key,
    problems,
)

_NORMAL_FORCE = (0.04, 24.0)
"""Bounds on normal forces, N per kg of the robot: a foot in contact is loaded slightly, and one foot can carry the
robot and stop its fall; the motors' forces are bounded by their torques."""


class Gain(Settings):
    """Feedback of a task: acceleration = kp (target - position) + kd (target rate - rate)."""

    kp: NonNegative = Field(description="Stiffness, 1/s2.")
    kd: NonNegative | None = key(None, "Damping, 1/s. null: critical, 2 sqrt(kp).")

    @property
    def damping(self) -> float:
        """Damping, 1/s."""
        return 2.0 * math.sqrt(self.kp) if self.kd is None else self.kd


class OwnTask(Extension):
    """A task of one's own: a class derived from :class:`lgmpc.wbc.Task`, or a function that returns one.

    A :class:`~lgmpc.wbc.SymbolicTask` is called with gain, weight and the arguments; a :class:`~lgmpc.wbc.NumericTask`
    and a function with the robot before these.
    """

    gain: Gain = key(Gain(kp=100.0), "Feedback.")
    weight: NonNegative = key(1.0, "Weight of the squared errors.")


class HandMove(Settings):
    """A smooth motion of a hand to a pose, from wherever its target is at the time; what is omitted stays."""

    at_s: NonNegative = Field(description="Begin of the motion, s.")
    duration_s: Annotated[Positive, Field(ge=0.05)] = key(
        1.0, "Duration, s, at least 0.05; velocity and acceleration are zero at both ends."
    )
    position_m: Vector3 | None = key(None, "[ahead, left, up] from the base's origin, m.")
    rpy_deg: Vector3 | None = key(None, "[roll, pitch, yaw] of the frame: Rz(yaw) Ry(pitch) Rx(roll), degrees.")


class HandSettings(Settings):
    """A frame that is held where it is at the start, in the world or relative to the base, and moved from there.

    Poses in the world are relative to where the base stood at the start: to its origin, in the axes of its heading.
    """

    frame: str = Field(min_length=1, description="Name of the frame (link) that is held; of the task, too.")
    relative_to: Literal["world", "base"] = key("base", "base: it moves with the base; world: it stays.")
    gain: Gain = key(Gain(kp=1600.0), "Feedback of position and rotation.")
    integral_gain: NonNegative = key(0.0, "Feedback of the integrals of the errors, against lasting pulls, 1/s3.")
    weight: NonNegative = key(100.0, "Weight of the linear acceleration.")
    rotation_weight: NonNegative = key(10.0, "Weight of the angular acceleration.")
    # Less than a millimetre is below the errors of any arm; more than a metre lets a distant target throw the robot.
    largest_error_m: Annotated[float, Field(strict=True, ge=1e-3, le=1.0)] = key(
        0.03, "Error to which the feedback is limited: a target out of reach does not pull over, m."
    )
    reach_m: Positive | None = key(
        None,
        "Horizontal distance from the centre of mass beyond which a standing robot steps towards the end of a motion in"
        " the world, by locomotion.reaction.gait, m. null: it does not.",
    )
    moves: tuple[HandMove, ...] = key((), "Motions, in order of time.")

    @field_validator("moves")
    @classmethod
    def _one_after_the_other(cls, moves: tuple[HandMove, ...]) -> tuple[HandMove, ...]:
        for i, (before, move) in enumerate(pairwise(moves), start=1):
            end = before.at_s + before.duration_s
            if move.at_s < end - 1e-9:
                raise problems(
                    [Problem(f"{i}.at_s", move.at_s, f"a time from the end of the motion before on, {end:g} s")]
                )
        return moves


class WholeBodyWeights(Settings):
    """Weights of the tasks' squared errors in the quadratic programme; 0 leaves a task out.

    Those of momenta and forces are for a robot of 2.5 kg; they are divided by the square of the mass ratio.
    """

    com: Vector3 = key((10.0, 10.0, 10.0), "Acceleration of the centre of mass [x, y, z].")
    base_orientation: NonNegative = key(0.1, "Angular acceleration of the base.")
    base_position: NonNegative = key(0.0, "Linear acceleration of the base.")
    angular_momentum: NonNegative = key(100.0, "Rate of the angular momentum (scaled by mass).")
    posture: NonNegative = key(1e-3, "Joint accelerations towards the reference posture.")
    upper_body_joints: NonNegative = key(
        10.0,
        "Accelerations of joints that move no foot, such as an arm's, towards the reference posture; of humanoids"
        " short_support_weights has them.",
    )
    stance: NonNegative = key(1e3, "Acceleration of the feet in contact, which should not move.")
    swing: NonNegative = key(10.0, "Acceleration of the feet in the air.")
    force: NonNegative = key(1e-4, "Contact forces, towards those of the MPC (scaled by mass).")
    acceleration: NonNegative = key(1e-6, "All accelerations (regularisation).")


class SteppingWeights(Settings):
    """Weights that replace those of :class:`WholeBodyWeights` while feet swing; the others are unchanged.

    Two feet exert no moment about the line between them: attitude and centre of mass compete for the same forces, and
    the ratio of their weights determines that of tilt to sway. On all feet there is no such conflict; under a push that
    nearly unloads feet, errors of height and attitude are preferable to steps.
    """

    com: Vector3 = key((100.0, 100.0, 100.0), "Acceleration of the centre of mass [x, y, z].")
    base_orientation: NonNegative = key(1.5, "Angular acceleration of the base (scaled by mass: for 2.5 kg).")
    angular_momentum: NonNegative = key(1.0, "Rate of the angular momentum (scaled by mass).")
    posture: NonNegative = key(1e-4, "Joint accelerations towards the reference posture.")


class ShortSupportWeights(Settings):
    """Weights that replace those of :class:`WholeBodyWeights` while a robot stands on a support short of its height.

    As on two feet of a quadruped, attitude and centre of mass compete for the forces at the edge of a humanoid's soles.
    Trunk and arms turn to stop a push: what they take up of its moment, the soles need not.
    """

    com: Vector3 = key((100.0, 100.0, 100.0), "Acceleration of the centre of mass [x, y, z].")
    base_orientation: NonNegative = key(0.03, "Angular acceleration of the base (scaled by mass: for 2.5 kg).")
    angular_momentum: NonNegative = key(0.1, "Rate of the angular momentum (scaled by mass).")
    posture: NonNegative = key(1e-4, "Joint accelerations towards the reference posture.")
    upper_body_joints: NonNegative = key(0.01, "Accelerations of joints that move no foot to the reference posture.")


class WholeBodyGains(Settings):
    """Feedback gains of the tasks."""

    com: Gain = key(Gain(kp=100.0), "Centre of mass.")
    base_orientation: Gain = key(Gain(kp=400.0), "Orientation of the base.")
    base_position: Gain = key(Gain(kp=100.0), "Position of the base.")
    angular_momentum: NonNegative = key(10.0, "Centroidal angular momentum, 1/s.")
    posture: Gain = key(Gain(kp=100.0), "Joint positions.")
    stance_damping: NonNegative = key(20.0, "Velocity of the feet in contact, 1/s.")
    swing: Gain = key(Gain(kp=1600.0), "Feet in the air.")


class WholeBodySettings(Settings):
    """Whole-body quadratic programme over accelerations and contact forces."""

    # No drives are faster than 20 kHz; below 10 Hz a falling robot tilts by degrees between two ticks.
    rate_hz: Annotated[float, Field(strict=True, ge=10.0, le=20_000.0)] = key(1000.0, "Ticks per second, Hz.")
    # Rubber on dry ground stays below 2; no force can be held with almost none.
    friction: Annotated[float, Field(strict=True, ge=0.01, le=3.0)] = key(0.6, "Assumed friction coefficient.")
    friction_facets: Annotated[int, Field(strict=True, ge=3, le=32)] | None = key(
        None, "Sides of the pyramid inscribed in the friction cone, 3 to 32. null: 12, at corners of soles 4."
    )
    normal_force_n: RangeFromZero | None = key(
        None, "[lowest, highest] normal force of a foot in contact, N. null: 0.04 and 24 per kg of the robot."
    )
    # Shorter than a tick of the fastest drive, the bound allows a joint to pass its limit between two ticks; beyond
    # seconds, every joint is always near its limit.
    joint_horizon_s: Annotated[float, Field(strict=True, ge=1e-4, le=10.0)] = key(
        0.02, "Look-ahead within which no joint may exceed its position or velocity limit, s."
    )
    # Below 1 rad/s2 a joint past its limit hardly returns; beyond 1e6 the number means no bound.
    joint_acceleration_max_rad_s2: Annotated[float, Field(strict=True, ge=1.0, le=1e6)] = key(
        2000.0, "Largest acceleration that the joint limits may require, rad/s2."
    )
    weights: WholeBodyWeights = key(WholeBodyWeights(), "Weights of the tasks.")
    stepping_weights: SteppingWeights = key(SteppingWeights(), "Weights of tasks while the robot steps.")
    short_support_weights: ShortSupportWeights = key(
        ShortSupportWeights(),
        "Weights of tasks while a robot stands whose centre of mass is nearer to the edge of its support"
        " than a quarter of its height, such as a humanoid.",
    )
    gains: WholeBodyGains = key(WholeBodyGains(), "Gains of the tasks.")
    hands: tuple[HandSettings, ...] = key((), "Frames to hold and to move, such as a gripper.")
    tasks: tuple[OwnTask, ...] = key((), "Tasks of one's own, beside the standard ones.")
    solver: Literal["active_set", "proxqp"] = key(
        "active_set",
        "active_set: exact, compiled, warm-started from the last tick's active limits; ProxQP where it "
        "fails. proxqp: ProxQP alone.",
    )
    # Rounding of the residuals is about 1e-12; residuals of a tenth of a newton make the torques useless.
    tolerance: Annotated[float, Field(strict=True, ge=1e-12, le=0.1)] = key(1e-5, "Tolerance on the residuals.")
    max_iterations: Count = key(50, "Largest number of solver iterations per tick.")
    fallback_damping_nms: NonNegative = key(0.1, "Joint damping added if the solver fails, N.m.s/rad.")

    def scaled(self, robot: Robot) -> "WholeBodySettings":
        """Return the settings for this robot: the weights of momenta and forces and the normal forces by its mass."""
        factor, weights, stepping = weight_factor(robot.mass), self.weights, self.stepping_weights
        short, turning = self.short_support_weights, turning_factor(robot.mass)
        return self.replace(
            {
                "weights.angular_momentum": factor * weights.angular_momentum,
                "weights.force": factor * weights.force,
                "stepping_weights.angular_momentum": factor * stepping.angular_momentum,
                "stepping_weights.base_orientation": turning * stepping.base_orientation,
                "short_support_weights.angular_momentum": factor * short.angular_momentum,
                "short_support_weights.base_orientation": turning * short.base_orientation,
                "friction_facets": chosen_facets(self.friction_facets, not robot.foot_points.single),
                "normal_force_n": normal_force_range(self.normal_force_n, _NORMAL_FORCE, robot.mass),
            }
        )
