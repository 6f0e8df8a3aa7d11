import dataclasses

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.errors import InputError
from lgmpc.robot import RobotSpec, load_robot
from lgmpc.wbc import WholeBodyTerms

RADII = (0.0, 0.016, 0.2)
H = 1e-5


def with_radius(robot, radius):
    return dataclasses.replace(robot, contact_radius=radius)


def frame_placements(robot, q):
    data = robot.create_data()
    pin.framesForwardKinematics(robot.model, data, q)
    return [data.oMf[frame].copy() for frame in robot.contact_ids]


def material_points(robot, q, local):
    """Where the points that are ``local`` in the feet's frames are, world axes."""
    return np.array([m.act(point) for m, point in zip(frame_placements(robot, q), local, strict=True)])


@pytest.mark.parametrize("radius", RADII)
def test_contact_jacobian_is_the_velocity_of_the_material_contact_point(solo12, random_state, radius):
    robot = with_radius(solo12, radius)
    terms = WholeBodyTerms(robot)
    rng = np.random.default_rng(1)
    for _ in range(5):
        q, v = random_state(rng)
        terms.update(q, v)
        points = np.array([m.translation for m in frame_placements(robot, q)]) - [0.0, 0.0, radius]
        np.testing.assert_allclose(terms.contact_points, points, atol=1e-14)
        local = [m.actInv(p) for m, p in zip(frame_placements(robot, q), points, strict=True)]
        for k in range(robot.nv):
            step = H * np.eye(robot.nv)[k]
            ahead = material_points(robot, pin.integrate(robot.model, q, step), local)
            behind = material_points(robot, pin.integrate(robot.model, q, -step), local)
            np.testing.assert_allclose(terms.contact_jacobian[:, k], ((ahead - behind) / (2 * H)).ravel(), atol=1e-9)


@pytest.mark.parametrize("radius", RADII)
def test_contact_drift_is_the_rate_of_the_rolling_velocity(solo12, random_state, radius):
    robot = with_radius(solo12, radius)
    terms = WholeBodyTerms(robot)
    data = robot.create_data()

    def rolling_velocity(q, v):
        """Velocity of the sphere's lowest material point: the centre's plus omega x (-r e_z)."""
        pin.forwardKinematics(robot.model, data, q, v)
        velocities = [
            pin.getFrameVelocity(robot.model, data, frame, pin.LOCAL_WORLD_ALIGNED) for frame in robot.contact_ids
        ]
        return np.concatenate([m.linear + np.cross(m.angular, [0.0, 0.0, -radius]) for m in velocities])

    rng = np.random.default_rng(2)
    for _ in range(10):
        q, v = random_state(rng)
        terms.update(q, 4.0 * v)
        ahead = rolling_velocity(pin.integrate(robot.model, q, H * 4.0 * v), 4.0 * v)
        behind = rolling_velocity(pin.integrate(robot.model, q, -H * 4.0 * v), 4.0 * v)
        np.testing.assert_allclose(terms.contact_drift, (ahead - behind) / (2 * H), atol=1e-6)


def test_foot_centre_differentiates_the_contact_points(solo12, random_state):
    terms = WholeBodyTerms(solo12)
    rng = np.random.default_rng(3)
    for _ in range(5):
        q, v = random_state(rng)
        track = []
        for s in (-1, 0, 1):
            terms.update(pin.integrate(solo12.model, q, s * 1e-4 * v), v)
            track.append(terms.contact_points.copy())
        terms.update(q, v)
        for foot in range(solo12.nc):
            jacobian, drift = terms.foot_centre(foot)
            behind, here, ahead = (points[foot] for points in track)
            np.testing.assert_allclose(jacobian @ v, (ahead - behind) / 2e-4, atol=1e-6)
            np.testing.assert_allclose(drift, (ahead - 2 * here + behind) / 1e-8, atol=1e-5)


def test_every_term_is_current_after_every_update(solo12, random_state):
    """Terms are views of memory that Pinocchio writes to; taken once, they must follow every update."""
    terms = WholeBodyTerms(solo12)
    views = {name: getattr(terms, name) for name in ("mass_matrix", "bias", "momentum_matrix", "com", "rotation")}
    views |= {"momentum": terms.momentum, "momentum_drift": terms.momentum_drift}
    rng = np.random.default_rng(4)
    model = solo12.model
    for _ in range(5):
        q, v = random_state(rng)
        terms.update(q, v)
        data = model.createData()
        expected = {
            "mass_matrix": pin.crba(model, data, q),
            "bias": pin.rnea(model, data, q, v, np.zeros(solo12.nv)),
            "momentum_drift": pin.dccrba(model, data, q, v) @ v,
            "momentum_matrix": pin.ccrba(model, data, q, v),
            "momentum": pin.computeCentroidalMomentum(model, data, q, v).np,
            "com": pin.centerOfMass(model, data, q),
            "rotation": pin.Quaternion(q[3:7]).matrix(),
        }
        for name, view in views.items():
            assert view is getattr(terms, name)
            np.testing.assert_allclose(view, expected[name], atol=1e-12, err_msg=name)
        np.testing.assert_array_equal(terms.q, q)
        np.testing.assert_array_equal(terms.v, v)


def test_mass_momentum_and_energy_are_the_sum_of_the_bodies(solo12, random_state):
    """An oracle that uses no algorithm of Pinocchio's but forward kinematics."""
    terms = WholeBodyTerms(solo12)
    q, v = random_state(np.random.default_rng(5))
    terms.update(q, v)
    model, data = solo12.model, solo12.create_data()
    pin.forwardKinematics(model, data, q, v)
    mass, moment, momentum, energy = 0.0, np.zeros(3), np.zeros(6), 0.5 * np.dot(solo12.armature, v[6:] ** 2)
    bodies = []
    for i in range(1, model.njoints):
        body, placement, twist = model.inertias[i], data.oMi[i], data.v[i]
        omega = placement.rotation @ twist.angular
        velocity = placement.rotation @ (twist.linear + np.cross(twist.angular, body.lever))
        spin = placement.rotation @ body.inertia @ twist.angular
        centre = placement.act(body.lever)
        bodies.append((body.mass, centre, velocity, spin))
        mass += body.mass
        moment += body.mass * centre
        energy += 0.5 * (body.mass * velocity @ velocity + omega @ spin)
    com = moment / mass
    for m, centre, velocity, spin in bodies:
        momentum[:3] += m * velocity
        momentum[3:] += spin + np.cross(centre - com, m * velocity)
    np.testing.assert_allclose(terms.com, com, atol=1e-13)
    np.testing.assert_allclose(terms.momentum, momentum, atol=1e-12)
    np.testing.assert_allclose(terms.momentum_matrix @ v, momentum, atol=1e-12)
    np.testing.assert_allclose(0.5 * v @ terms.mass_matrix @ v, energy, rtol=1e-12)


def test_robots_that_cannot_stand_are_refused(solo12):
    with pytest.raises(InputError, match="without contact frames.*expected a robot with contact frames"):
        WholeBodyTerms(dataclasses.replace(solo12, contact_frames=(), contact_ids=()))
    with pytest.raises(InputError, match="fixed base"):
        WholeBodyTerms(load_robot(RobotSpec(model="panda")))
