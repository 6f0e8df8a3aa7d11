"""Robots: loading, checking, and symbolic rigid-body algorithms over any ``pin.Model``."""

from lgmpc.robot.collision import Box, Capsule, CollisionShape, Sphere, place_shape, shape_of
from lgmpc.robot.legs import leg_chain, leg_clearances, leg_joints, leg_normals, upper_body_joints
from lgmpc.robot.loading import load_robot
from lgmpc.robot.model import ModelSource, Robot
from lgmpc.robot.soles import Foot, FootPoints, FootSpec
from lgmpc.robot.sources import available_models
from lgmpc.robot.spec import RobotSpec

__all__ = [
    "Box",
    "Capsule",
    "CollisionShape",
    "Foot",
    "FootPoints",
    "FootSpec",
    "Sphere",
    "ModelSource",
    "Robot",
    "RobotSpec",
    "available_models",
    "upper_body_joints",
    "leg_chain",
    "leg_clearances",
    "leg_joints",
    "leg_normals",
    "load_robot",
    "place_shape",
    "shape_of",
]
