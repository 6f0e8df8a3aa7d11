"""Settings that predictive controllers share; a model's own are beside the model."""

from typing import Annotated, Literal

from pydantic import Field

from lgmpc.robot import Robot
from lgmpc.robot.friction import chosen_facets
from lgmpc.robot.scaling import normal_force_range, weight_factor
from lgmpc.settings import Count, NonNegative, Positive, RangeFromZero, Settings, Vector3, key
from lgmpc.timegrid import TimeGrid

_NORMAL_FORCE = (0.2, 24.0)
"""Bounds on normal forces, N per kg of the robot: no foot is unloaded entirely, and one foot may carry 2.4 weights."""


class CentroidalWeights(Settings):
    """Weights of the squared deviations of momenta and forces over a horizon.

    Those of momenta and forces are for a robot of 2.5 kg; they are divided by the square of the mass ratio.
    """

    com: Vector3 = key((1e3, 1e3, 1e3), "Position of the centre of mass [x, y, z], 1/m2.")
    linear_momentum: NonNegative = key(10.0, "Linear momentum, 1/(kg.m/s)2 (scaled by mass).")
    angular_momentum: NonNegative = key(
        10.0, "Angular momentum about the centre of mass, 1/(kg.m2/s)2 (scaled by mass)."
    )
    force: Positive = key(1e-3, "Contact forces, from an even share of the weight, 1/N2 (scaled by mass).")
    terminal: NonNegative = key(10.0, "Factor on the state's weights at the last node.")

    def state(self, mass: float) -> list[float]:
        """Return the weights of [centre of mass; linear momentum; angular momentum] for a robot of ``mass`` kg."""
        factor = weight_factor(mass)
        return [*self.com, *[factor * self.linear_momentum] * 3, *[factor * self.angular_momentum] * 3]

    def forces(self, contacts: int, mass: float) -> list[float]:
        """Return the weights of all contacts' forces for a robot of ``mass`` kg."""
        return [weight_factor(mass) * self.force] * (3 * contacts)


class MpcSettings(Settings):
    """Horizon, limits and disturbance prediction of any predictive controller."""

    model: str = Field(description="Predictive model.")
    enabled: bool = Field(default=True, strict=True, description="false: the whole-body controller runs alone.")
    rate_hz: Annotated[Positive, Field(ge=1.0, le=1e4)] = key(100.0, "Updates per second, Hz, 1 to 10000.")
    nodes: Annotated[int, Field(strict=True, ge=2, le=200)] = key(20, "Number of intervals of the horizon, 2 to 200.")
    node_s: Annotated[Positive, Field(ge=1e-3, le=1.0)] = key(
        0.02, "Length of each interval, s, 0.001 to 1: the resolution of contact switches."
    )
    friction: Annotated[Positive, Field(ge=0.01, le=5.0)] = key(0.6, "Assumed friction coefficient, 0.01 to 5.")
    normal_force_n: RangeFromZero | None = key(
        None, "[lowest, highest] normal force of a foot in contact, N. null: 0.2 and 24 per kg of the robot."
    )
    observer_time_s: Annotated[Positive, Field(ge=1e-4)] = key(
        0.01, "Smallest time constant of the observer of the external wrench, s."
    )
    observer_noise_share: Annotated[Positive, Field(le=1e3)] = key(
        0.05,
        "Noise of the estimated force, as a share of the robot's weight (standard deviation in each axis), "
        "beyond which that time constant grows with the noise of the measured velocity.",
    )
    wrench_decay_s: Annotated[Positive, Field(ge=1e-3)] = key(
        0.1, "Time constant of the predicted decay of the estimated wrench, s."
    )
    stale_after: Count = key(5, "Number of consecutive failed updates after which the plan is no longer used.")
    qp_solver: Literal["active_set", "osqp", "piqp"] = key(
        "active_set",
        "Solver of each quadratic programme. active_set: lgmpc's own, its Riccati sweep in scalar code for"
        " small stages and in dense blocks for large ones.",
    )
    sqp_iterations: Count = key(1, "Quadratic programmes per update; 1 is the real-time iteration.")
    friction_facets: Annotated[int, Field(strict=True, ge=3, le=32)] | None = key(
        None, "Sides of the pyramid inscribed in the friction cone, 3 to 32. null: 12, at corners of soles 4."
    )

    @property
    def horizon(self) -> TimeGrid:
        """Intervals of the horizon, from 0 s."""
        return TimeGrid(self.node_s, self.nodes)

    def normal_force(self, mass: float) -> tuple[float, float]:
        """Return the lowest and highest normal force of a foot of a robot of ``mass`` kg, N."""
        return normal_force_range(self.normal_force_n, _NORMAL_FORCE, mass)

    def facets(self, robot: Robot) -> int:
        """Return the number of facets at each contact point of a robot."""
        return chosen_facets(self.friction_facets, not robot.foot_points.single)
