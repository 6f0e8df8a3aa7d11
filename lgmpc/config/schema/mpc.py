"""Config section ``mpc``: the predictive controller above the whole-body controller; its keys depend on its model."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Union

from pydantic import Discriminator, Field, Tag

from lgmpc.settings import Count, NonNegative, Positive, RangeFromZero, Settings, Vector3

__all__ = [
    "CentroidalMpcSection",
    "FullBodyMpcSection",
    "FullBodyMpcWeights",
    "KinodynamicMpcSection",
    "KinodynamicMpcWeights",
    "LqrMpcSection",
    "LqrMpcWeights",
    "MpcSection",
    "MpcWeights",
    "WholeBodyMpcWeights",
]


class LqrMpcWeights(Settings):
    """Weights of the squared deviations that the regulator minimises.

    Those of momenta and forces are for a robot of 2.5 kg: a heavier one's are divided by the square of its mass ratio.
    """

    com: Vector3 = Field(default=(1e3, 1e3, 1e3), description="Position of the centre of mass [x, y, z], 1/m2.")
    linear_momentum: NonNegative = Field(default=10.0, description="Linear momentum, 1/(kg.m/s)2 (scaled by mass).")
    angular_momentum: NonNegative = Field(
        default=10.0, description="Angular momentum about the centre of mass, 1/(kg.m2/s)2 (scaled by mass)."
    )
    force: Positive = Field(
        default=1e-3, description="Contact forces, from an even share of the weight, 1/N2 (scaled by mass)."
    )


class MpcWeights(LqrMpcWeights):
    """Weights of the squared deviations that the MPC minimises."""

    terminal: NonNegative = Field(default=10.0, description="Factor on the state's weights at the last node.")


class WholeBodyMpcWeights(MpcWeights):
    """Weights of models that know base and joints."""

    base_orientation: NonNegative = Field(default=1.0, description="Turn of the base, 1/rad2.")
    posture: NonNegative = Field(default=0.1, description="Joints, from the reference posture, 1/rad2.")


class KinodynamicMpcWeights(WholeBodyMpcWeights):
    """Weights of the squared deviations that the kinodynamic MPC minimises."""

    joint_velocity: Positive = Field(default=1e-3, description="Speeds of the joints, 1/(rad/s)2.")


class FullBodyMpcWeights(WholeBodyMpcWeights):
    """Weights of the squared deviations that the full-body MPC minimises."""

    joint_velocity: NonNegative = Field(default=1e-3, description="Speeds of the joints, 1/(rad/s)2.")
    effort: Positive = Field(
        default=1e-3, description="Joint torques, from those that hold the posture, 1/(N.m)2 (scaled by mass)."
    )


class _MpcSection(Settings):
    """What all models have."""

    enabled: bool = Field(default=True, strict=True, description="false: the whole-body controller works alone.")
    rate_hz: Positive = Field(default=100.0, description="Updates per second, Hz.")
    nodes: Annotated[int, Field(strict=True, ge=2, le=200)] = Field(
        default=20, description="Number of intervals of the horizon, 2 to 200."
    )
    node_s: Annotated[Positive, Field(le=1.0)] = Field(
        default=0.02, description="Length of each interval, s, at most 1."
    )
    friction: Positive = Field(default=0.6, description="Friction coefficient that the MPC relies on.")
    normal_force_n: RangeFromZero | None = Field(
        default=None,
        description="[lowest, highest] normal force of a foot in contact, N. null: 0.2 and 12 a kg of robot.",
    )
    observer_time_s: Positive = Field(
        default=0.01, description="Time constant of the observer that estimates what pushes the robot, s."
    )
    wrench_decay_s: Positive = Field(
        default=0.1, description="Time constant with which the observed push is predicted to fade, s."
    )


class _OptimisingMpcSection(_MpcSection):
    """What models have whose plans are solutions of a problem with constraints."""

    qp_solver: Literal["riccati", "osqp", "piqp", "piqp_multistage", "proxqp"] = Field(
        default="riccati", description="Solver of each quadratic programme."
    )
    sqp_iterations: Count = Field(
        default=1, description="Quadratic programmes per update; 1 is the real-time iteration."
    )
    friction_facets: Annotated[int, Field(strict=True, ge=3, le=32)] = Field(
        default=12, description="Sides of the pyramid inscribed in the friction cone, 3 to 32."
    )


class LqrMpcSection(_MpcSection):
    """Linear-quadratic regulation of the momenta by contact forces, linearised about standing."""

    model: Literal["lqr"] = Field(default="lqr", description="Model that predicts.")
    uprighting_rate_hz: NonNegative = Field(
        default=3.0, description="Rate at which the plan turns a tilted base upright, 1/s."
    )
    weights: LqrMpcWeights = Field(default=LqrMpcWeights(), description="Weights of the cost.")


class CentroidalMpcSection(_OptimisingMpcSection):
    """Model-predictive control of the momenta by contact forces over a receding horizon."""

    model: Literal["centroidal"] = Field(default="centroidal", description="Model that predicts.")
    uprighting_rate_hz: NonNegative = Field(
        default=3.0, description="Rate at which the plan turns a tilted base upright, 1/s."
    )
    weights: MpcWeights = Field(default=MpcWeights(), description="Weights of the cost.")


class _WholeBodyMpcSection(_OptimisingMpcSection):
    """What models that know base and joints have."""

    rate_hz: Positive = Field(default=50.0, description="Updates per second, Hz.")
    reach_rad: Positive = Field(
        default=0.9,
        description="How far joints of a plan may be from the reference posture, rad; less than what stretches a leg."
        " Where it is further, the centroidal model plans instead.",
    )


class KinodynamicMpcSection(_WholeBodyMpcSection):
    """Model-predictive control of momenta and posture by contact forces and joint velocities."""

    model: Literal["kinodynamic"] = Field(default="kinodynamic", description="Model that predicts.")
    weights: KinodynamicMpcWeights = Field(default=KinodynamicMpcWeights(), description="Weights of the cost.")


class FullBodyMpcSection(_WholeBodyMpcSection):
    """Model-predictive control of the whole robot by its torques, which have limits as the forces have."""

    model: Literal["full_body"] = Field(default="full_body", description="Model that predicts.")
    weights: FullBodyMpcWeights = Field(default=FullBodyMpcWeights(), description="Weights of the cost.")


def _model(value: Any) -> Any:
    """The model that a section names; the centroidal one where it names none."""
    if isinstance(value, Mapping):
        return value.get("model", "centroidal")
    return getattr(value, "model", "centroidal")


MpcSection = Annotated[
    Union[  # noqa: UP007
        Annotated[CentroidalMpcSection, Tag("centroidal")],
        Annotated[KinodynamicMpcSection, Tag("kinodynamic")],
        Annotated[FullBodyMpcSection, Tag("full_body")],
        Annotated[LqrMpcSection, Tag("lqr")],
    ],
    Discriminator(_model),
]
"""The section of one of the models; the key ``model`` tells which."""
