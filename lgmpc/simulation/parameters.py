"""Parameters in which a simulated robot may differ from the controller's model; its model, momentum and energy."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Union

import numpy as np
import pinocchio as pin
from pydantic import Discriminator, Field, Tag, model_validator

from lgmpc.errors import ModelError
from lgmpc.robot import Robot
from lgmpc.settings import Finite, Friction, NonNegative, Positive, Settings, Vector3, key, problem
from lgmpc.simulation.drives import ActuatorSettings, LinkSettings
from lgmpc.typing import Array
from lgmpc.world import Plane, World

_NO_INERTIA = 1e-15
"""Moments below this are zero, kg.m2: those of the smallest grain of sand."""


def _posture_kind(value: Any) -> str:
    return "angles" if isinstance(value, Mapping) else "name"


InitialPosture = Annotated[
    Union[Annotated[Literal["reference", "lying"], Tag("name")], Annotated[dict[str, Finite], Tag("angles")]],  # noqa: UP007
    Discriminator(_posture_kind),
]


class PlantSettings(Settings):
    """The physics engine and the simulated robot."""

    kind: Literal["mujoco", "pinocchio"] = key("mujoco", "Physics engine.")
    rate_hz: Annotated[Positive, Field(ge=10.0, le=1e6)] = key(1000.0, "Steps of the engine per second, Hz, 10 to 1e6.")
    integrator: Literal["implicitfast", "implicit", "euler", "rk4"] = key(
        "implicitfast", "Integrator of MuJoCo. The Pinocchio plant has only the default."
    )
    friction: Friction = key(0.6, "Coulomb friction coefficient between robot and ground.")
    joint_friction_nm: Annotated[NonNegative, Field(le=1e4)] = key(0.0, "Coulomb friction of every joint, N.m.")
    joint_damping_nms: Annotated[NonNegative, Field(le=1e4)] = key(0.0, "Viscous friction of every joint, N.m.s/rad.")
    mass_scale: Annotated[Positive, Field(ge=0.01, le=100.0)] = key(1.0, "Factor on masses and inertias, 0.01 to 100.")
    base_added_mass_kg: Annotated[NonNegative, Field(le=1e4)] = key(
        0.0, "Payload at the base's centre of mass (not scaled) that the controllers' model lacks, kg."
    )
    base_com_offset_m: Vector3 = key(
        (0.0, 0.0, 0.0),
        "Shift of the base's centre of mass, payload included, that the controllers' model lacks, base axes, m.",
    )
    initial_posture: InitialPosture = key(
        "reference",
        "Posture at the start: reference (that of the robot), lying (on its belly, the legs folded), or "
        "{joint name or pattern: rad or m} for joints that differ from the reference; the lowest point on the ground.",
    )
    initial_height_m: Annotated[NonNegative, Field(le=100.0)] = key(0.0, "Height from which it falls at the start, m.")
    initial_attitude_deg: Vector3 = key(
        (0.0, 0.0, 0.0),
        "Rotation of the robot about its base at the start, a rotation vector in base axes, degrees: [180, "
        "0, 0] is upside down. Its height and posture remain.",
    )
    initial_velocity_m_s: Vector3 = key((0.0, 0.0, 0.0), "Initial velocity of the robot, base axes, m/s.")
    initial_rotation_rad_s: Vector3 = key((0.0, 0.0, 0.0), "Initial angular velocity of the robot, base axes, rad/s.")
    link: LinkSettings = key(LinkSettings(), "Delays, losses and noise of the link to the robot.")
    actuators: ActuatorSettings = key(ActuatorSettings(), "The drives of the joints.")

    @model_validator(mode="after")
    def _pinocchio_has_one_integrator(self) -> "PlantSettings":
        if self.kind == "pinocchio" and self.integrator != "implicitfast":
            raise problem("no choice of the integrator with kind = pinocchio", key="integrator", got=self.integrator)
        return self

    @property
    def dt(self) -> float:
        """Duration of one step, s."""
        return 1.0 / self.rate_hz


def default_world(params: PlantSettings) -> World:
    """Return a level floor with the friction of the parameters."""
    return World((Plane(coefficient=params.friction),))


def real_effort_limit(robot: Robot, params: PlantSettings) -> Array:
    """Return the (nu,) torque limits of the simulated drives, N.m."""
    limit = params.actuators.torque_limit_nm
    return robot.effort_limit if limit is None else np.full(robot.nu, limit)


def simulated_model(robot: Robot, params: PlantSettings) -> pin.Model:
    """Return a copy of the robot's model with the masses of the simulated robot; both plants are built from it.

    Raises:
        ModelError: bodies without inertia, such as links that their URDF gives none; names them.
    """
    model = robot.model.copy()
    lacking = [model.names[i] for i in range(1, model.njoints) if np.abs(model.inertias[i].inertia).max() < _NO_INERTIA]
    for joint in range(1, model.njoints):
        body = model.inertias[joint]
        mass, lever, inertia = body.mass * params.mass_scale, body.lever, body.inertia * params.mass_scale
        if joint == 1:
            mass += params.base_added_mass_kg
            lever = lever + np.asarray(params.base_com_offset_m)
        try:
            model.inertias[joint] = pin.Inertia(mass, lever, inertia)
        except RuntimeError as error:  # a moment below zero by rounding, which the checks of a robot let pass
            links = f"links behind joints {', '.join(lacking or [model.names[joint]])}"
            raise ModelError(
                robot.name, [f"no inertia about their centre of mass: {links}; give <inertial>"]
            ) from error
    return model


def momentum_and_energy(robot: Robot, settings: PlantSettings, q: Array, v: Array) -> tuple[Array, Array, Array]:
    """Return the linear momentum and the mechanical energy, rotors included, of the simulated robot, and its weight.

    Args:
        robot: the controllers' model.
        settings: parameters in which the simulated robot differs.
        q: (k, nq) configurations.
        v: (k, nv) velocities.

    Returns:
        (k, 3) momenta, N.s, world axes, (k,) energies, J, and the (3,) weight, N, world axes.
    """
    model = simulated_model(robot, settings)
    data = model.createData()
    momentum, energy = np.empty((len(q), 3)), np.empty(len(q))
    for i, (position, velocity) in enumerate(zip(q, v, strict=True)):
        pin.computeCentroidalMomentum(model, data, position, velocity)
        momentum[i] = data.hg.linear
        # Not computeKineticEnergy: in Pinocchio 4.1 it leaves out the rotors of some joints (five of ANYmal's twelve).
        upper = np.triu(pin.crba(model, data, position))
        kinetic = velocity @ upper @ velocity - 0.5 * np.diag(upper) @ velocity**2
        energy[i] = kinetic + pin.computePotentialEnergy(model, data, position)
    return momentum, energy, sum(body.mass for body in model.inertias[1:]) * np.array(model.gravity.linear)
