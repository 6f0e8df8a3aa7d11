"""A ROS 2 node that walks a robot of ros2_control: ``python ros2_node.py CONFIG``.

Reads imu (sensor_msgs/Imu in the axes of the base), joint_states (sensor_msgs/JointState), of which each message is a
tick, and cmd_vel (geometry_msgs/Twist). Publishes the torques of the config's joints, in their order, at
effort_controller/commands (std_msgs/Float64MultiArray), for an effort_controllers/JointGroupEffortController.
"""

import queue
import sys
import threading

import numpy as np
import rclpy
from geometry_msgs.msg import Twist
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Float64MultiArray

import lgmpc
from lgmpc.config.build import build_controller, build_estimator, build_robot
from lgmpc.control import Command, Measurement
from lgmpc.hardware import JointLimits, deploy
from lgmpc.locomotion.command import CommandFunction, MotionCommand
from lgmpc.simulation import control_ticks


class RosDriver(Node):
    """An lgmpc.hardware.Driver over topics."""

    def __init__(self, joints: tuple[str, ...]) -> None:
        super().__init__("lgmpc")
        self.joints, self.imu, self.twist = joints, None, Twist()
        self.arrived: queue.Queue[Measurement] = queue.Queue()
        self.create_subscription(Imu, "imu", lambda message: setattr(self, "imu", message), qos_profile_sensor_data)
        self.create_subscription(JointState, "joint_states", self.take, qos_profile_sensor_data)
        self.create_subscription(Twist, "cmd_vel", lambda message: setattr(self, "twist", message), 1)
        self.efforts = self.create_publisher(Float64MultiArray, "effort_controller/commands", 1)

    def take(self, state: JointState) -> None:
        """Queue a measurement, from the thread that spins."""
        if self.imu is not None and set(self.joints) <= set(state.name):
            order, stamp = [state.name.index(name) for name in self.joints], state.header.stamp
            joints = (np.array(each, dtype=float)[order] for each in (state.position, state.velocity, state.effort))
            vectors = (np.array([v.x, v.y, v.z]) for v in (self.imu.angular_velocity, self.imu.linear_acceleration))
            self.arrived.put(Measurement(stamp.sec + 1e-9 * stamp.nanosec, *vectors, *joints))

    def read(self, timeout_s: float) -> list[Measurement]:
        """Return what has arrived, after waiting for the first one."""
        try:
            found = [self.arrived.get(timeout=timeout_s)]
        except queue.Empty:
            return []
        found += [self.arrived.get() for _ in range(self.arrived.qsize())]
        self.last = found[-1]
        return found

    def write(self, command: Command) -> None:
        """Publish torques; the gains of section drives act here, at the rate of the messages."""
        self.efforts.publish(Float64MultiArray(data=command.torque(self.last.joints, self.last.speeds).tolist()))

    def close(self) -> None:
        """Publish no torque."""
        self.efforts.publish(Float64MultiArray(data=[0.0] * len(self.joints)))


if __name__ == "__main__":
    config = lgmpc.load_config(sys.argv[1])
    robot = build_robot(config)
    controller = build_controller(config, robot)
    estimator = build_estimator(config, robot, controller)
    rclpy.init()
    node = RosDriver(robot.joint_names)
    twist_of = lambda t: MotionCommand(node.twist.linear.x, node.twist.linear.y, node.twist.angular.z)  # noqa: E731
    controller.commands = CommandFunction(twist_of)
    threading.Thread(target=rclpy.spin, args=(node,), daemon=True).start()
    limits = JointLimits(robot.joint_names, robot.effort_limit, robot.velocity_limit)
    ticks = control_ticks(1.0 / config.plant.rate_hz, config.wbc.rate_hz, config.duration_s)
    print(deploy(node, controller, estimator, ticks=ticks, settings=config.deployment, limits=limits))
    rclpy.shutdown()
