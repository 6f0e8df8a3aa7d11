"""The robot in a time-stepping simulation of contact on Pinocchio's own frictional contact solver.

One step finds the velocity at its end and the contact impulses together (Signorini's and Coulomb's laws on velocities,
[1], [2]), then moves the configuration along its Lie group with that velocity (semi-implicit Euler):

    v+ = v + M^-1 (dt (S^T tau + J_b^T w - h) + J^T lambda),    q+ = q (+) dt v+
    |lambda_t| <= mu lambda_n,   0 <= lambda_n  perpendicular to  u_n + phi >= 0   with u = J v+,

and a contact that slides resists with all its friction, opposite to u_t. Impulses and velocities of a contact are those
along its own axes, two tangents and the normal n of the surface there, at the point ``p - r n`` of a sphere of radius
r. ``phi`` is its distance from the surface over dt for a foot that may still descend, and a bounded fraction of that
for one that has sunk in. Soft ground, a spring K with a damper C, gives way by the velocity
``lambda_n / (dt (C + K dt))`` besides, and ``phi`` is ``K / (C + K dt)`` times the distance of a foot in it: the force
is theirs at the end of the step. Joint damping enters M (it is implicit); joint
friction enters the solver as bounded impulses on the joints.

[1] D. E. Stewart and J. C. Trinkle, "An implicit time-stepping scheme for rigid body dynamics with inelastic collisions
    and Coulomb friction", 1996.
[2] Q. Le Lidec et al., "Contact models in robotics: a comparative analysis", 2024.
"""

from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from lgmpc.robot import Robot
from lgmpc.simulation.parameters import PlantSettings, default_world, real_effort_limit, simulated_model
from lgmpc.simulation.plant import BodyWrenches, PlantSample, check_speed, check_state, check_torque
from lgmpc.typing import Array, IntArray
from lgmpc.world import World

_FASTEST = 10.0  # m/s; points that cannot reach the ground in a step at this speed are left out of that step's problem
_RECOVERY = 0.2  # fraction of a penetration that one step removes, ...
_RISE = 0.01  # m/s; ... but no faster than this, because the speed remains after the penetration
_CREEP = 1e-3  # rad/s; speed of a stuck joint under all of its friction, without which problems become too stiff
# Most iterations, tolerance of velocities and impulses (m/s, N.s), and of their products (J).
_GAUSS_SEIDEL = (100, 1e-8, 1e-10)
_ADMM = (1000, 1e-7, 1e-9)


class PinocchioPlant:
    """A robot on the ground of a world with rigid, inelastic contacts: an independent check of the MuJoCo plant.

    Feet are spheres at the contact frames (``robot.foot_points``), and ``robot.collision_shapes`` touch the ground
    as well. Joint position limits are not modelled.

    Args:
        robot: the robot; its ``effort_limit`` clips the torques.
        params: parameters of the engine and of the simulated robot.
        world: its surfaces; a level floor with the friction of ``params`` unless given.

    Attributes:
        dt: duration of one step, s.
        bodies: names of the bodies that a wrench can act on.
    """

    def __init__(self, robot: Robot, params: PlantSettings | None = None, world: World | None = None) -> None:
        params = PlantSettings() if params is None else params
        self._robot = robot
        self._world = default_world(params) if world is None else world
        self.dt, self.bodies = params.dt, robot.body_names
        self._soft = soft = self._world.soft
        self._resistance = np.inf if soft is None else self.dt * (soft.damping_ns_m + soft.stiffness_n_m * self.dt)
        self._joints = robot.joint_v
        self._effort = real_effort_limit(robot, params)
        self._damping = params.joint_damping_nms
        self._friction = params.joint_friction_nm
        self._wrenches = BodyWrenches(robot)
        self._model = simulated_model(robot, params)
        # (M + dt D) (v+ - v) = dt (tau - D v - h): viscous friction at the velocity of the step's end.
        inertia = self._model.armature.copy()
        inertia[self._joints] += params.dt * params.joint_damping_nms
        self._model.armature = inertia
        self._frames, self._radii = _contact_points(self._model, robot)
        self._data = self._model.createData()
        # Views into the workspace, whose address is constant: world positions of the spheres that may touch the ground.
        self._centres = [self._data.oMf[frame].translation for frame in self._frames]
        self._frames_key, self._contact_frames = b"", _ContactFrames.of(np.zeros((0, 3)), np.zeros(0))
        self._solver = _ContactSolver(self._model, params, len(self._frames), robot.nu)
        self.reset(robot.x_reference)

    @property
    def unsolved_steps(self) -> int:
        """Steps since reset at which the contact solver stopped short of its tolerance; they used its last iterate."""
        return self._solver.failures

    def reset(self, x: Array) -> None:
        """Put the robot into state ``x = (q, v)``, clear wrenches and set the time to zero.

        Raises:
            InputError: if ``x`` is not a finite state with a unit quaternion.
        """
        q, v = check_state(self._model, x)
        self._q, self._v = q.copy(), v.copy()
        self._tau, self._forces = np.zeros(self._robot.nu), np.zeros((self._robot.nc, 3))
        self._steps = 0
        self._wrenches.clear()
        self._applied: dict[int, Array] = {}
        self._solver.reset()

    def resume(self, sample: PlantSample) -> None:
        """Continue, without wrenches, from a sample of another plant of the same robot and engine."""
        self.reset(np.concatenate([sample.q, sample.v]))
        pin.framesForwardKinematics(self._model, self._data, self._q)
        feet = slice(self._robot.nc)
        axes = _ContactFrames.of(self._world.distance(np.array(self._centres[feet]))[1], self._radii[feet]).axes
        self._solver.impulses[feet, 0] = np.matmul(axes, sample.contact_forces[:, :, None])[:, :, 0] * self.dt
        self._tau, self._steps = sample.tau, round(sample.time / self.dt)
        self._forces = sample.contact_forces.copy()

    def step(self, tau: Array) -> None:
        """Advance by ``dt`` under joint torques ``tau`` (nu,), N.m, clipped at the actuators' limits.

        Raises:
            InputError: if ``tau`` does not have nu finite elements.
            SolverError: if the simulation diverged.
        """
        check_torque(tau, self._robot.nu)
        model, data, q, v, dt = self._model, self._data, self._q, self._v, self.dt
        self._tau = np.minimum(np.maximum(tau, -self._effort), self._effort)
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        force = -pin.nonLinearEffects(model, data, q, v)
        force[self._joints] += self._tau - self._damping * v[self._joints]
        for joint, wrench in self._applied.items():
            force += self._generalized(joint, wrench)
        minverse = pin.computeMinverse(model, data, q)
        free = v + minverse @ (dt * force)
        near, gaps, frames, friction = self._near_ground()
        self._v, forces = free, np.zeros((len(self._frames), 3))
        if near.size or self._friction:
            jacobian = self._jacobian(near, frames)
            response = minverse @ jacobian.T
            drift, delassus = jacobian @ free, jacobian @ response
            normal = np.arange(2, 3 * len(near), 3)
            drift[normal] += [gap / dt if gap > 0.0 else self._recovery(gap) for gap in gaps]
            delassus[normal, normal] += 1.0 / self._resistance
            self._v = free + response @ self._solver.solve(near, friction, delassus, drift)
            np.add.at(forces, near, np.matmul(self._solver.contact_impulses[:, None], frames.axes)[:, 0] / dt)
        else:
            self._solver.clear()
        self._forces = forces[: self._robot.nc]
        self._q = pin.integrate(model, q, dt * self._v)
        self._steps += 1
        check_speed(self._v, "Pinocchio plant", self._steps * dt)

    def sense(self) -> PlantSample:
        """Return the state reached by the last step."""
        return PlantSample(self._steps * self.dt, self._q.copy(), self._v.copy(), self._tau, self._forces)

    def set_wrench(self, body: str, wrench: Array) -> None:
        """Apply ``wrench`` (6,) = [force; torque] in world axes at the centre of mass of ``body`` until it is changed.

        Links joined by fixed joints are one body: its centre of mass is that of all of them together, payload included,
        and wrenches on several of them add up.

        Raises:
            InputError: if the body is unknown (names the nearest) or the wrench is not six finite numbers.
        """
        joint, total = self._wrenches.set(body, wrench)
        self._applied.pop(joint, None)
        if total.any():
            self._applied[joint] = total

    def body_point(self, body: str) -> Array:
        """Return the (3,) world position of the centre of mass of ``body``."""
        joint = self._wrenches.joint(body)
        pin.forwardKinematics(self._model, self._data, self._q)
        return self._data.oMi[joint].act(self._model.inertias[joint].lever)

    def _generalized(self, joint: int, wrench: Array) -> Array:
        """Return the generalized force (nv,) of a wrench at the centre of mass of the body that ``joint`` moves."""
        jacobian = pin.getJointJacobian(self._model, self._data, joint, pin.LOCAL_WORLD_ALIGNED)
        jacobian = jacobian.reshape(6, self._model.nv)  # Pinocchio gives a plain vector where nv is 1
        arm = self._data.oMi[joint].rotation @ self._model.inertias[joint].lever
        return jacobian[:3].T @ wrench[:3] + jacobian[3:].T @ (wrench[3:] + np.cross(arm, wrench[:3]))

    def _recovery(self, gap: float) -> float:
        """Return the velocity at which a contact below the ground, at ``gap`` < 0, m, would have no force, m/s."""
        if self._soft is None:
            return max(_RECOVERY * gap / self.dt, -_RISE)
        return self._soft.stiffness_n_m * gap / (self._soft.damping_ns_m + self._soft.stiffness_n_m * self.dt)

    def _near_ground(self) -> "tuple[IntArray, list[float], _ContactFrames, Array]":
        """Return the contacts that may close in this step: their points, distances, frames and friction."""
        positions = np.array(self._centres).reshape(-1, 3)
        near, distances, normals, friction = self._world.contacts(positions, self._radii, _FASTEST * self.dt)
        radii = self._radii[near]
        key = normals.tobytes() + radii.tobytes()
        if key != self._frames_key:  # not on a plane while the same points are near
            self._frames_key, self._contact_frames = key, _ContactFrames.of(normals, radii)
        return near, (distances - radii).tolist(), self._contact_frames, friction

    def _jacobian(self, near: IntArray, frames: "_ContactFrames") -> Array:
        """Return the rows of the contact points along their axes, then of the joints if they have friction."""
        joints = self._joints
        count = 3 * len(near)
        rows = np.zeros((count + (self._robot.nu if self._friction else 0), self._model.nv))
        for k, i in enumerate(near.tolist()):
            frame = pin.getFrameJacobian(self._model, self._data, self._frames[i], pin.LOCAL_WORLD_ALIGNED)
            frame = frame.reshape(6, self._model.nv)
            point = frame[:3] + frames.levers[k] @ frame[3:]
            rows[3 * k : 3 * k + 3] = point if frames.level else frames.axes[k] @ point
        if self._friction:
            rows[count:, joints] = np.eye(self._robot.nu)
        return rows


class _ContactSolver:
    """Finds contact impulses by projected Gauss-Seidel, started from those of the step before; if it fails, by ADMM.

    Gauss-Seidel takes a few sweeps for a robot on its feet. On redundant contacts (a trunk on its corners) it may never
    converge; ADMM does, at a higher cost.

    Attributes:
        contact_impulses: (k, 3) impulses of the last solve along the axes of its contacts, N.s.
        impulses: (n, 4, 3) those of each point that can touch the ground, of up to four contacts; guesses of the next.
        failures: solves since reset that stopped short of their tolerance.
    """

    def __init__(self, model: pin.Model, params: PlantSettings, points: int, nu: int) -> None:
        self._model, self._params, self._points = model, params, points
        # Joints with friction, and their degrees of freedom; the joints of a free-flyer are not actuated.
        first = 1 if nu == model.nv else 2
        self._actuated = list(range(first, model.njoints)) if params.joint_friction_nm else []
        self._joints = nu if params.joint_friction_nm else 0
        self._compliance = _CREEP / (params.joint_friction_nm * params.dt) if params.joint_friction_nm else 0.0
        self._problems: dict[tuple[float, ...], tuple[Any, Any]] = {}
        self._settings = pin.PGSSolverSettings(), pin.ADMMSolverSettings()
        for settings, limits in zip(self._settings, (_GAUSS_SEIDEL, _ADMM), strict=True):
            settings.max_iterations, feasibility, complementarity = limits
            settings.absolute_feasibility_tol = settings.relative_feasibility_tol = feasibility
            settings.absolute_complementarity_tol = settings.relative_complementarity_tol = complementarity
        self._settings[1].admm_update_rule = pin.ADMMUpdateRule.SPECTRAL
        self.reset()

    def reset(self) -> None:
        """Clear the results of earlier solves."""
        self._solvers = pin.PGSConstraintSolver(), pin.ADMMConstraintSolver()
        self._results = pin.PGSSolverResult(), pin.ADMMSolverResult()
        self.failures = 0
        self.clear()

    def clear(self) -> None:
        """Set all impulses to zero: there are no contacts."""
        self.contact_impulses, self.impulses = np.zeros((0, 3)), np.zeros((self._points, 4, 3))
        self._joint_impulses = np.zeros(self._joints)

    def solve(self, near: IntArray, friction: Array, delassus: Array, drift: Array) -> Array:
        """Return the impulses (3 len(near) + joints,), those of the contacts first.

        Args:
            near: (k,) points of the contacts, those of one point in a row; all others have no impulse.
            friction: (k,) coefficients.
            delassus: square matrix of the velocities due to unit impulses.
            drift: velocity without impulses.
        """
        count = 3 * len(near)
        slots = near, np.minimum(np.arange(len(near)) - np.searchsorted(near, near), self.impulses.shape[1] - 1)
        guess = np.concatenate([self.impulses[slots].ravel(), self._joint_impulses])
        diagonal = np.arange(count, guess.size)
        delassus[diagonal, diagonal] += self._compliance
        operator = pin.DelassusOperatorDense(delassus)
        constraints = self._problem(tuple(friction.tolist()))
        for solver, settings, result in zip(self._solvers, self._settings, self._results, strict=True):
            result.setConstraintImpulseGuess(guess)
            if solver.solve(operator, drift, *constraints, settings, result):
                break
        else:
            self.failures += 1
        solution: Array = result.retrieveConstraintImpulses()
        self.clear()
        self.impulses[slots] = self.contact_impulses = solution[:count].reshape(-1, 3)
        self._joint_impulses = solution[count:]
        return solution

    def _problem(self, coefficients: tuple[float, ...]) -> tuple[Any, Any]:
        """Return the constraints of contacts with these coefficients; the solver reads only their friction cones."""
        if coefficients not in self._problems:
            models, datas = pin.StdVec_ConstraintModel(), pin.StdVec_ConstraintData()
            for coefficient in coefficients:
                contact = pin.PointContactConstraintModel(self._model, 0)
                contact.setFriction(coefficient)
                models.append(contact)
            if self._actuated:
                bound = np.full(self._joints, self._params.joint_friction_nm)
                friction = pin.JointFrictionConstraintModel(self._model, self._actuated)
                friction.setFrictionLowerLimit(-bound)
                friction.setFrictionUpperLimit(bound)
                friction.setTimeStep(self._params.dt)
                models.append(friction)
            for model in models:
                datas.append(model.createData())
            self._problems[coefficients] = (models, datas)
        return self._problems[coefficients]


class _ContactFrames(NamedTuple):
    """Geometry of k contacts of spheres of radius r with surfaces of unit normal n.

    Attributes:
        axes: (k, 3, 3) whose rows are two tangents of the surface and its normal, world axes.
        levers: (k, 3, 3) matrices ``r [n]x``: the contact point ``c - r n`` moves by ``r n x omega`` besides c.
        level: whether all axes are the world's.
    """

    axes: Array
    levers: Array
    level: bool

    @classmethod
    def of(cls, normals: Array, radii: Array) -> "_ContactFrames":
        """Return the frames (Duff et al., "Building an orthonormal basis, revisited", 2017)."""
        x, y, z = normals.T
        a = -1.0 / (1.0 + z)
        b = a * x * y
        first, second = np.stack([1.0 + a * x * x, b, -x]), np.stack([b, 1.0 + a * y * y, -y])
        axes: Array = np.stack([first, second, normals.T]).transpose(2, 0, 1)
        levers = np.array([radius * pin.skew(normal) for normal, radius in zip(normals, radii, strict=True)])
        return cls(axes, levers.reshape(-1, 3, 3), not normals[:, :2].any())


def _contact_points(model: pin.Model, robot: Robot) -> tuple[list[int], Array]:
    """Return frames and radii of the spheres that can touch the ground, feet first; adds corners of shapes."""
    frames, radii = list(robot.contact_ids), [robot.foot_points.radius] * robot.nc
    for part in robot.collision_shapes:
        for i, (placement, radius) in enumerate(part.corners):
            corner = pin.Frame(f"{part.name}, corner {i}", part.joint, 0, placement, pin.FrameType.OP_FRAME)
            frames.append(model.addFrame(corner, False))
            radii.append(radius)
    return frames, np.array(radii)
