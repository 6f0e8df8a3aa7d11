"""The built-in tasks, by name: each is one class here, with its weight and gain in :mod:`lgmpc.wbc.settings`."""

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin

from lgmpc.costs import Parameter, StageSymbols
from lgmpc.lie.symbolic import so3
from lgmpc.robot import Robot, leg_normals, upper_body_joints
from lgmpc.robot.contact_points import ContactPoints
from lgmpc.wbc.hands import HandTask
from lgmpc.wbc.settings import Gain, WholeBodySettings
from lgmpc.wbc.tasks import SymbolicTask, Task, TaskRows
from lgmpc.wbc.terms import WholeBodyTerms

_FLATTENING = 400.0
"""1/s2; feedback of the height of a standing sole's points above its lowest one: 100 leaves them rocking."""


class ComTask(SymbolicTask):
    """Centre of mass, world axes, m. Orin, Goswami, Lee, "Centroidal dynamics of a humanoid robot", 2013."""

    name = "com"
    dim = 3

    def position(self, s: StageSymbols) -> Any:
        """Return the centre of mass."""
        return s.com

    def velocity(self, s: StageSymbols) -> Any:
        """Return its velocity."""
        return s.robot.vcom(s.q, s.v)

    def jacobian(self, s: StageSymbols) -> Any:
        """Return its Jacobian, a by-product of the mass matrix's recursion."""
        return s.robot.jacobian_com(s.q)

    def drift(self, s: StageSymbols) -> Any:
        """Return its acceleration at zero joint-space acceleration."""
        return s.robot.momentum_rate(s.q, s.v, None)[:3] / s.robot.mass

    def stand(self, robot: Robot, terms: WholeBodyTerms) -> None:
        """Hold the sensed centre of mass."""
        self.hold(terms.com)


class BaseOrientationTask(SymbolicTask):
    """Orientation of the base: error ``log(R^T R_d)``, rate ``R^T R_d omega_d - omega``, body axes.

    Targets: ``rotation`` (3, 3), body to world; ``angular_velocity`` (3,) in the axes of the target frame, rad/s.
    """

    name = "base_orientation"
    dim = 3

    def targets(self) -> list[tuple[Parameter, tuple[int, ...]]]:
        """Return the target rotation, row by row, and angular velocity."""
        rotation = Parameter("rotation", 9, "orientation of the base, body to world", np.eye(3).ravel())
        return [(rotation, (3, 3)), (Parameter("angular_velocity", 3, "in the axes of the target, rad/s"), (3,))]

    def velocity(self, s: StageSymbols) -> Any:
        """Return the body angular velocity, an entry of v."""
        return s.v[3:6]

    def error(self, s: StageSymbols) -> Any:
        """Return the rotation vector to the target."""
        return so3.log(self._to_target(s))

    def rate(self, s: StageSymbols) -> Any:
        """Return the target's angular velocity minus the base's."""
        return ca.mtimes(self._to_target(s), s["angular_velocity"]) - s.v[3:6]

    def acceleration(self, s: StageSymbols) -> Any:
        """Return zero: there is no feed-forward."""
        return ca.SX.zeros(3)

    def stand(self, robot: Robot, terms: WholeBodyTerms) -> None:
        """Hold the orientation of the reference posture."""
        self.target.rotation[:] = pin.Quaternion(robot.q_reference[3:7]).matrix()
        self.target.angular_velocity[:] = 0.0

    @staticmethod
    def _to_target(s: StageSymbols) -> Any:
        return ca.mtimes(s.robot.joint_placement(s.q, 1).rotation.T, ca.reshape(s["rotation"], 3, 3).T)


class BasePositionTask(SymbolicTask):
    """Position of the base's origin, world axes, m."""

    name = "base_position"
    dim = 3

    def position(self, s: StageSymbols) -> Any:
        """Return the origin."""
        return s.q[:3]

    def velocity(self, s: StageSymbols) -> Any:
        """Return its velocity."""
        return ca.mtimes(s.robot.joint_placement(s.q, 1).rotation, s.v[:3])

    def stand(self, robot: Robot, terms: WholeBodyTerms) -> None:
        """Hold the sensed position."""
        self.hold(terms.q[:3])


class AngularMomentumTask(SymbolicTask):
    """Centroidal angular momentum, world axes; it is a rate itself, so there is no stiffness.

    Targets: ``momentum`` (3,) N.m.s; ``rate`` (3,) feed-forward, N.m.
    """

    name = "angular_momentum"
    dim = 3

    def targets(self) -> list[tuple[Parameter, tuple[int, ...]]]:
        """Return the target momentum and its rate."""
        return [
            (Parameter("momentum", 3, "angular momentum about the centre of mass, N.m.s"), (3,)),
            (Parameter("rate", 3, "its rate, N.m"), (3,)),
        ]

    def velocity(self, s: StageSymbols) -> Any:
        """Return the angular momentum."""
        return s.momentum[3:]

    def error(self, s: StageSymbols) -> Any:
        """Return zero."""
        return ca.SX.zeros(3)

    def rate(self, s: StageSymbols) -> Any:
        """Return the error of the momentum."""
        return s["momentum"] - self.velocity(s)

    def acceleration(self, s: StageSymbols) -> Any:
        """Return the target rate."""
        return s["rate"]

    def jacobian(self, s: StageSymbols) -> Any:
        """Return the angular rows of the centroidal momentum matrix."""
        return s.robot.momentum_matrix(s.q)[3:, :]

    def drift(self, s: StageSymbols) -> Any:
        """Return the rate at zero joint-space acceleration."""
        return s.robot.momentum_rate(s.q, s.v, None)[3:]

    def stand(self, robot: Robot, terms: WholeBodyTerms) -> None:
        """Set zero angular momentum."""
        self.target.momentum[:] = self.target.rate[:] = 0.0


class _JointsTask(SymbolicTask):
    """Positions of joints, given by their entries of configuration and velocity."""

    def __init__(self, q: Any, v: Any, dim: int, gain: Gain, weight: float | Sequence[float]) -> None:
        self._q, self._v, self.dim = q, v, dim
        super().__init__(gain, weight)

    def position(self, s: StageSymbols) -> Any:
        """Return the joint positions."""
        return s.q[self._q]

    def velocity(self, s: StageSymbols) -> Any:
        """Return the joint rates."""
        return s.v[self._v]

    def stand(self, robot: Robot, terms: WholeBodyTerms) -> None:
        """Hold the reference posture."""
        self.hold(robot.q_reference[self._q])


class PostureTask(_JointsTask):
    """Joint positions, rad (m)."""

    name = "posture"

    def __init__(self, robot: Robot, gain: Gain, weight: float | Sequence[float]) -> None:
        super().__init__(robot.joint_q, robot.joint_v, robot.nu, gain, weight)


class UpperBodyTask(_JointsTask):
    """Positions of the joints that move no foot, such as an arm's on the base, rad (m).

    Contacts leave them free: with the small weight of the posture alone, they would move to shift momentum.
    """

    name = "upper_body_joints"

    def __init__(self, robot: Robot, gain: Gain, weight: float | Sequence[float]) -> None:
        joints = [robot.model.joints[joint] for joint in upper_body_joints(robot)]
        q, v = ([int(getattr(joint, entry)) for joint in joints] for entry in ("idx_q", "idx_v"))
        super().__init__(q, v, len(joints), gain, weight)


class _FeetTask(SymbolicTask):
    """Three rows for each foot, active in stance or in swing."""

    def __init__(self, robot: Robot, gain: Gain, weight: float | Sequence[float]) -> None:
        self.dim = 3 * robot.nc
        self._robot = robot
        super().__init__(gain, weight)

    def _contacts(self, s: StageSymbols) -> ContactPoints:
        return ContactPoints(self._robot, s.q, s.v, s["normals"])

    @staticmethod
    def _in_contact(s: StageSymbols) -> Any:
        return ca.vec(ca.repmat(s["stance"].T, 3, 1))


class StanceTask(_FeetTask):
    """The material points in contact do not accelerate, and their velocity is damped; there is no target.

    A large weight is used instead of an equality, which would become infeasible together with the torque limits near
    stretched legs; only velocities are fed back, because a rolling sphere's contact point moves, and of soles the
    attitude: one that landed on an edge, or was tipped, would stay so, as its points stand still.
    """

    name = "stance"

    def targets(self) -> list[tuple[Parameter, tuple[int, ...]]]:
        """Return none."""
        return []

    def velocity(self, s: StageSymbols) -> Any:
        """Return the velocities of the material points in contact."""
        return self._contacts(s).velocities()

    def error(self, s: StageSymbols) -> Any:
        """Return the way of each point of a sole down to the surface through its lowest one; of point feet, zero."""
        feet, normals = self._robot.foot_points, ca.reshape(s["normals"], 3, -1)
        if feet.single:
            return ca.SX.zeros(self.dim)
        heights = ca.sum1(normals * ca.reshape(self._contacts(s).positions(), 3, -1)).T
        lowest = [ca.mmin(heights[i : i + n]) for i, n in zip(feet.starts.tolist(), feet.counts.tolist(), strict=True)]
        return ca.vec(normals * ca.repmat((ca.vertcat(*feet.spread(lowest)) - heights).T, 3, 1))

    def rate(self, s: StageSymbols) -> Any:
        """Return the negative velocity, which is damped."""
        return -self.velocity(s)

    def acceleration(self, s: StageSymbols) -> Any:
        """Return zero."""
        return ca.SX.zeros(self.dim)

    def jacobian(self, s: StageSymbols) -> Any:
        """Return the contact Jacobian, an expression of the dynamics too."""
        return self._contacts(s).jacobian()

    def drift(self, s: StageSymbols) -> Any:
        """Return the rate of the velocities at zero joint-space acceleration."""
        return self._contacts(s).drift()

    def active(self, s: StageSymbols) -> Any:
        """Return which feet are in contact."""
        return self._in_contact(s)


class SwingTask(_FeetTask):
    """The contact points of the feet in the air follow their targets, world axes: the point moves as the centre does.

    Where a leg moves its foot in a plane only, the rows have no part normal to that plane: the base would have to move.

    Targets: ``position`` (nc, 3) m, ``velocity`` (nc, 3) m/s, ``acceleration`` (nc, 3) m/s2.
    """

    name = "swing"

    def __init__(self, robot: Robot, gain: Gain, weight: float | Sequence[float]) -> None:
        super().__init__(robot, gain, weight)
        self._normals = tuple(map(tuple, leg_normals(robot)[robot.foot_points.of].tolist()))

    def targets(self) -> list[tuple[Parameter, tuple[int, ...]]]:
        """Return position, velocity and acceleration of every foot."""
        return [(parameter, (self._robot.nc, 3)) for parameter, _ in super().targets()]

    def position(self, s: StageSymbols) -> Any:
        """Return the contact points."""
        return self._contacts(s).positions()

    def velocity(self, s: StageSymbols) -> Any:
        """Return their rates."""
        return self._contacts(s).centre_velocities()

    def jacobian(self, s: StageSymbols) -> Any:
        """Return the derivative of the rates by v."""
        return self._contacts(s).centre_jacobian()

    def drift(self, s: StageSymbols) -> Any:
        """Return the rate of the velocities at zero joint-space acceleration."""
        return self._contacts(s).centre_drift()

    def active(self, s: StageSymbols) -> Any:
        """Return which feet are in the air."""
        return 1 - self._in_contact(s)

    def rows(self, symbols: StageSymbols) -> TaskRows:
        """Return the rows, of planar legs without the part that is normal to their plane."""
        rows = super().rows(symbols)
        if not any(map(any, self._normals)):
            return rows
        turn = symbols.robot.joint_placement(symbols.q, 1).rotation
        normals = [ca.mtimes(turn, ca.SX(normal)) for normal in self._normals]
        within = ca.diagcat(*(ca.SX.eye(3) - ca.mtimes(normal, normal.T) for normal in normals))
        return TaskRows(ca.mtimes(within, rows.jacobian), ca.mtimes(within, rows.rhs), rows.weight)

    def stand(self, robot: Robot, terms: WholeBodyTerms) -> None:
        """Hold every foot at its present position."""
        self.hold(terms.contact_points)


TASKS: dict[str, Callable[[Robot, WholeBodySettings], Task]] = {
    "stance": lambda r, s: StanceTask(r, Gain(kp=_FLATTENING, kd=s.gains.stance_damping), s.weights.stance),
    "swing": lambda r, s: SwingTask(r, s.gains.swing, s.weights.swing),
    "com": lambda r, s: ComTask(s.gains.com, s.weights.com),
    "base_orientation": lambda r, s: BaseOrientationTask(s.gains.base_orientation, s.weights.base_orientation),
    "posture": lambda r, s: PostureTask(r, s.gains.posture, s.weights.posture),
    "upper_body_joints": lambda r, s: UpperBodyTask(r, s.gains.posture, s.weights.upper_body_joints),
    "base_position": lambda r, s: BasePositionTask(s.gains.base_position, s.weights.base_position),
    "angular_momentum": lambda r, s: AngularMomentumTask(
        Gain(kp=0.0, kd=s.gains.angular_momentum), s.weights.angular_momentum
    ),
}
"""Makes each built-in task from robot and settings (scaled by its mass), in the order of their rows."""


def standard_tasks(robot: Robot, settings: WholeBodySettings) -> list[Task]:
    """Return the built-in tasks with the weights and gains of ``settings``, not yet scaled by the robot's mass.

    Those of joints or feet that the robot lacks are left out.
    """
    scaled = settings.scaled(robot)
    hands = [HandTask(robot, hand) for hand in settings.hands]
    return [*(task for make in TASKS.values() if (task := make(robot, scaled)).dim), *hands]
