"""Robots: loading, checking, and symbolic rigid-body algorithms over any ``pin.Model``."""

from lgmpc.robot.collision import (
    Box as Box,
    Capsule as Capsule,
    CollisionShape as CollisionShape,
    ModelSource as ModelSource,
    Sphere as Sphere,
    place_shape as place_shape,
    shape_of as shape_of,
)
from lgmpc.robot.legs import (
    leg_chain as leg_chain,
    leg_joints as leg_joints,
    leg_normals as leg_normals,
    upper_body_joints as upper_body_joints,
)
from lgmpc.robot.loading import load_robot as load_robot
from lgmpc.robot.model import Robot as Robot
from lgmpc.robot.soles import Foot as Foot, FootPoints as FootPoints, FootSpec as FootSpec
from lgmpc.robot.sources import available_models as available_models
from lgmpc.robot.spec import RobotSpec as RobotSpec
