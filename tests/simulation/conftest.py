"""Robots for the plants: Solo12, a block on four corners, and a tree of every joint type that a plant supports."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.robot import Box, ModelSource, Robot, RobotSpec, Sphere, load_robot
from lgmpc.simulation.mujoco import MujocoPlant
from lgmpc.simulation.pinocchio import PinocchioPlant

FEET = ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT")
SHAPES = (Sphere(link="*_LOWER_LEG", radius_m=0.012), Box(link="base_link", half_size_m=(0.20, 0.08, 0.03)))


@pytest.fixture(scope="session")
def solo12() -> Robot:
    spec = RobotSpec(
        model="solo12",
        contact_frames=FEET,
        contact_radius_m=0.016,
        effort_limit_nm=1.8,
        velocity_limit_rad_s=30.0,
        position_limit_rad=(-3.0, 3.0),
        armature_kg_m2=3.6e-4,
        collision_shapes=SHAPES,
        posture={"*_HAA": 0.0, "F?_HFE": 0.8, "F?_KFE": -1.6, "H?_HFE": -0.8, "H?_KFE": 1.6},
    )
    return load_robot(spec)


@pytest.fixture(params=[MujocoPlant, PinocchioPlant], ids=["mujoco", "pinocchio"])
def plant_type(request):
    return request.param


def _robot(model: pin.Model, q: np.ndarray, feet: tuple[str, ...] = (), radius: float = 0.0) -> Robot:
    """A robot around a model made by hand, with torque limits of 50."""
    floating = model.joints[1].shortname() == "JointModelFreeFlyer"
    nu = model.nv - (6 if floating else 0)
    wide = np.full(nu, 1e3)
    return Robot(
        name=model.name,
        model=model,
        contact_frames=feet,
        contact_ids=tuple(model.getFrameId(name) for name in feet),
        contact_radius=radius,
        q_reference=q,
        effort_limit=np.full(nu, 50.0),
        velocity_limit=wide,
        joint_lower=-wide,
        joint_upper=wide,
        armature=np.array(model.armature)[model.nv - nu :],
        joint_friction=np.zeros(nu),
        source=ModelSource(Path("made-in-a-test.urdf")),
        given_shapes=(),
    )


@pytest.fixture(params=[0.0, 0.01], ids=["point feet", "spheres"])
def block(request) -> Robot:
    """A flat block of 2 kg, 0.4 x 0.4 x 0.05 m, that stands on its four lower corners; it has no joints."""
    radius = request.param
    model = pin.Model()
    model.name = "block"
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root_joint")
    model.appendBodyToJoint(joint, pin.Inertia.FromBox(2.0, 0.4, 0.4, 0.05), pin.SE3.Identity())
    model.addBodyFrame("block", joint, pin.SE3.Identity(), 0)
    corners = ((0.2, 0.2), (0.2, -0.2), (-0.2, 0.2), (-0.2, -0.2))
    names = []
    for i, (x, y) in enumerate(corners):
        placement = pin.SE3(np.eye(3), np.array([x, y, -0.025]))
        model.addFrame(pin.Frame(f"corner_{i}", joint, 0, placement, pin.FrameType.OP_FRAME))
        names.append(f"corner_{i}")
    q = np.array([0.0, 0.0, 0.025 + radius, 0.0, 0.0, 0.0, 1.0])
    return _robot(model, q, tuple(names), radius)


@pytest.fixture(scope="session")
def zoo() -> Robot:
    """A free-flying tree with skew placements, all joint types and full inertias."""
    rng = np.random.default_rng(7)
    model = pin.Model()
    model.name = "zoo"
    axis = np.array([1.0, -2.0, 0.5]) / np.linalg.norm([1.0, -2.0, 0.5])
    kinds = [
        (0, pin.JointModelFreeFlyer()),
        (1, pin.JointModelRX()),
        (2, pin.JointModelRevoluteUnaligned(axis)),
        (2, pin.JointModelPZ()),
        (4, pin.JointModelRUBY()),
        (1, pin.JointModelSpherical()),
        (6, pin.JointModelPrismaticUnaligned(axis)),
        (1, pin.JointModelRZ()),
    ]
    for i, (parent, kind) in enumerate(kinds):
        placement = pin.SE3.Identity() if i == 0 else pin.SE3.Random()
        if i:
            rotation = pin.Quaternion(*rng.normal(size=4)).normalized().matrix()
            placement = pin.SE3(rotation, rng.uniform(-0.5, 0.5, 3))
        joint = model.addJoint(parent, kind, placement, f"joint_{i}")
        spread = rng.normal(size=(3, 6))  # of some point masses: any inertia made so is a possible one
        moment = 0.1 * (np.trace(spread @ spread.T) * np.eye(3) - spread @ spread.T)
        model.appendBodyToJoint(
            joint, pin.Inertia(rng.uniform(0.5, 2), rng.normal(size=3) * 0.1, moment), pin.SE3.Identity()
        )
        model.addBodyFrame(f"link_{i}", joint, pin.SE3.Identity(), 0)
    # A spherical joint has one rotor inertia in MuJoCo.
    armature = np.zeros(model.nv)
    for joint in list(model.joints)[2:]:
        armature[joint.idx_v : joint.idx_v + joint.nv] = rng.uniform(0.01, 0.1)
    model.armature = armature
    return _robot(model, pin.neutral(model))


@pytest.fixture(scope="session")
def random_state() -> Callable[..., tuple[np.ndarray, np.ndarray]]:
    """Makes a tilted, moving state ``(q, v)`` high above the floor."""

    def make(robot: Robot, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        q = pin.integrate(robot.model, robot.q_reference, rng.uniform(-1.5, 1.5, robot.nv))
        q[2] = 10.0
        return q, rng.uniform(-2, 2, robot.nv)

    return make


@pytest.fixture(scope="session")
def hold() -> Callable[..., None]:
    """Keeps the reference posture by joint impedance for some steps."""

    def drive(plant, robot: Robot, steps: int, kp: float = 8.0, kd: float = 0.2) -> None:
        target = robot.q_reference[robot.joint_q]
        for _ in range(steps):
            sample = plant.sense()
            plant.step(kp * (target - sample.q[robot.joint_q]) - kd * sample.v[robot.joint_v])

    return drive


@pytest.fixture(scope="session")
def make_robot() -> Callable[..., Robot]:
    """Makes a robot around a model built in a test."""
    return _robot
