"""What both plants promise, whatever the engine."""

import math
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.errors import InputError
from lgmpc.robot import Box, RobotSpec, load_robot
from lgmpc.simulation.disturbances import Push, PushSchedule
from lgmpc.simulation.loop import true_state
from lgmpc.simulation.parameters import PlantSettings
from lgmpc.simulation.plant import PlantSample

GRAVITY = 9.81
ANGLES = (0.0, 0.3, math.pi / 4, 2.5)


def direction(angle):
    return np.array([math.cos(angle), math.sin(angle), 0.0])


def momentum(robot, sample):
    """Centroidal momentum about the centre of mass, and the centre of mass itself."""
    data = robot.create_data()
    pin.computeCentroidalMomentum(robot.model, data, sample.q, sample.v)
    return np.array(data.hg), np.array(data.com[0])


def test_it_starts_at_the_reference_posture_at_rest(plant_type, solo12):
    sample = plant_type(solo12).sense()
    np.testing.assert_array_equal(sample.q, solo12.q_reference)
    assert not sample.v.any() and not sample.tau.any() and not sample.contact_forces.any()
    assert sample.time == 0.0
    assert sample.contact_forces.shape == (4, 3)


def test_free_fall(plant_type, solo12):
    plant = plant_type(solo12)
    x = solo12.x_reference.copy()
    x[2] = 5.0
    plant.reset(x)
    steps = 400
    for _ in range(steps):
        plant.step(np.zeros(12))
    sample = plant.sense()
    t = steps * plant.dt
    assert sample.time == pytest.approx(t, rel=1e-14)
    np.testing.assert_allclose(sample.v, np.r_[0, 0, -GRAVITY * t, np.zeros(15)], rtol=0, atol=1e-11)
    np.testing.assert_allclose(sample.q[2], 5.0 - GRAVITY * t * (t + plant.dt) / 2, rtol=0, atol=1e-11)
    assert not sample.contact_forces.any()


def test_settled_robot_is_carried_by_its_feet(plant_type, solo12, hold):
    plant = plant_type(solo12)
    hold(plant, solo12, 3000)
    sample = plant.sense()
    assert np.abs(sample.v).max() < 1e-3  # feet creep a little in MuJoCo
    total = sample.contact_forces.sum(axis=0)
    np.testing.assert_allclose(total, (0, 0, solo12.mass * GRAVITY), rtol=0, atol=1e-3)
    # No moment about the centre of mass: the forces are at the right feet.
    data = solo12.create_data()
    centre = pin.centerOfMass(solo12.model, data, sample.q)
    pin.framesForwardKinematics(solo12.model, data, sample.q)
    points = [data.oMf[i].translation - (0, 0, solo12.contact_radius) for i in solo12.contact_ids]
    moment = np.cross(np.array(points) - centre, sample.contact_forces).sum(axis=0)
    np.testing.assert_allclose(moment, 0, rtol=0, atol=1e-3)
    assert sample.contact_forces[:, 2].min() > 4.0


@pytest.mark.parametrize("extra", [{"mass_scale": 1.3}, {"base_added_mass_kg": 0.8}, {"joint_friction_nm": 0.05}])
def test_feet_carry_the_simulated_weight(plant_type, solo12, hold, extra):
    params = PlantSettings(**extra)
    plant = plant_type(solo12, params)
    hold(plant, solo12, 2500, kp=16.0, kd=0.4)
    weight = (solo12.mass * params.mass_scale + params.base_added_mass_kg) * GRAVITY
    np.testing.assert_allclose(plant.sense().contact_forces.sum(axis=0), (0, 0, weight), rtol=0, atol=0.02)


def test_centre_of_mass_offset_loads_the_front_feet(plant_type, solo12, hold):
    plant = plant_type(solo12, PlantSettings(base_com_offset_m=(0.03, 0.0, 0.0)))
    hold(plant, solo12, 2500, kp=16.0, kd=0.4)
    front, hind = plant.sense().contact_forces[:2, 2].sum(), plant.sense().contact_forces[2:, 2].sum()
    assert front > hind + 1.0


def test_torques_are_clipped_and_reported(plant_type, solo12):
    plant = plant_type(solo12)
    asked = np.linspace(-5.0, 5.0, 12)
    clipped = np.clip(asked, -1.8, 1.8)
    x = solo12.x_reference.copy()
    x[2] = 3.0
    plant.reset(x)
    plant.step(asked)
    beyond = plant.sense()
    np.testing.assert_array_equal(beyond.tau, clipped)
    plant.reset(x)
    plant.step(clipped)
    np.testing.assert_array_equal(plant.sense().v, beyond.v)
    np.testing.assert_array_equal(asked, np.linspace(-5.0, 5.0, 12))


def test_a_wrench_changes_the_momentum_by_its_impulse(plant_type, solo12):
    dt = 1e-5
    plant = plant_type(solo12, PlantSettings(rate_hz=1.0 / dt))
    x = solo12.x_reference.copy()
    x[2] = 3.0
    for body in ("base_link", "FR_UPPER_LEG"):
        plant.reset(x)
        wrench = np.array([3.0, -2.0, 1.0, 0.5, 0.3, -0.4])
        before, centre = momentum(solo12, plant.sense())
        arm = plant.body_point(body) - centre
        plant.set_wrench(body, wrench)
        for _ in range(2):  # it stays until it is changed
            plant.step(np.zeros(12))
        plant.set_wrench(body, np.zeros(6))
        plant.step(np.zeros(12))
        after, _ = momentum(solo12, plant.sense())
        rate = (after - before) / (2 * dt)
        rate[2] += 1.5 * solo12.mass * GRAVITY
        np.testing.assert_allclose(rate[:3], wrench[:3], rtol=0, atol=1e-6)
        np.testing.assert_allclose(rate[3:], wrench[3:] + np.cross(arm, wrench[:3]), rtol=0, atol=2e-3)


def test_wrenches_on_links_of_one_rigid_body_add_up(plant_type, solo12):
    plant = plant_type(solo12)
    x = solo12.x_reference.copy()
    x[2] = 3.0
    both, force = [], np.array([1.0, 2.0, 3.0, 0.0, 0.0, 0.0])
    for wrenches in ({"FL_LOWER_LEG": force, "FL_FOOT": force}, {"FL_LOWER_LEG": 2 * force}):
        plant.reset(x)
        for body, wrench in wrenches.items():
            plant.set_wrench(body, wrench)
        plant.step(np.zeros(12))
        both.append(plant.sense().v)
    np.testing.assert_array_equal(*both)
    assert np.abs(both[0][:3]).max() > 1e-4


def test_body_point_is_the_bodys_centre_of_mass_now(plant_type, solo12):
    plant = plant_type(solo12)
    x = solo12.x_reference.copy()
    x[2] = 3.0
    x[19] = 1.0  # forward
    plant.reset(x)
    first = plant.body_point("base_link")
    for _ in range(100):
        plant.step(np.zeros(12))
    second = plant.body_point("base_link")
    assert second[0] - first[0] == pytest.approx(0.1, abs=1e-9)
    q, model, data = plant.sense().q, solo12.model, solo12.create_data()
    pin.forwardKinematics(model, data, q)
    np.testing.assert_allclose(second, data.oMi[1].act(model.inertias[1].lever), rtol=0, atol=1e-14)


@pytest.mark.parametrize("angle", ANGLES)
def test_a_block_holds_below_the_friction_limit_and_slides_above(plant_type, block, angle):
    """Coulomb: at 0.95 mu N it stays; at 1.05 mu N it goes with 0.05 mu g."""
    mu, seconds = 0.5, 0.5
    ahead = direction(angle)
    travelled = {}
    for load in (0.95, 1.05):
        plant = plant_type(block, PlantSettings(friction=mu))
        for _ in range(200):
            plant.step(np.zeros(0))
        start = plant.sense().q[:3]
        plant.set_wrench("block", np.r_[load * mu * block.mass * GRAVITY * ahead, 0, 0, 0])
        for _ in range(round(seconds / plant.dt)):
            plant.step(np.zeros(0))
        travelled[load] = plant.sense().q[:3] - start
    expected = 0.05 * mu * GRAVITY * seconds**2 / 2
    assert np.linalg.norm(travelled[0.95]) < 2e-5
    # MuJoCo's soft contacts chatter under a sliding block: 7 % in the distance.
    np.testing.assert_allclose(travelled[1.05], expected * ahead, rtol=0, atol=0.1 * expected)


@pytest.mark.parametrize("angle", ANGLES)
def test_a_gliding_block_slows_down_by_mu_g(plant_type, block, angle):
    mu, speed, seconds = 0.5, 2.0, 0.3
    plant = plant_type(block, PlantSettings(friction=mu))
    x = block.x_reference.copy()
    x[7:10] = speed * direction(angle)
    plant.reset(x)
    for _ in range(round(seconds / plant.dt)):
        plant.step(np.zeros(0))
    sample = plant.sense()
    velocity = pin.Quaternion(sample.q[3:7]).matrix() @ sample.v[:3]
    loss = mu * GRAVITY * seconds
    # Friction acts against the motion, so the direction stays; see above for MuJoCo's margin.
    np.testing.assert_allclose(velocity[:2], (speed - loss) * direction(angle)[:2], rtol=0, atol=0.06 * loss)


def test_joint_friction_holds_a_joint_up_to_its_limit(plant_type, make_robot):
    """A wheel of inertia 0.1 under gravity's absence: 0.9 of the friction does not turn it, 2.0 does."""
    model = pin.Model()
    model.name = "wheel"
    joint = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "axle")
    model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), 0.1 * np.eye(3)), pin.SE3.Identity())
    model.addBodyFrame("rim", joint, pin.SE3.Identity(), 0)
    robot = make_robot(model, np.zeros(1))
    for torque, expected in ((0.9, 0.0), (2.0, 0.5)):  # 0.5 s at (2.0 - 1.0) * 0.1 / 0.1
        plant = plant_type(robot, PlantSettings(joint_friction_nm=0.1))
        for _ in range(500):
            plant.step(np.array([0.1 * torque]))
        # Both engines hold a joint by a stiff law, which lets it creep at a thousandth of a radian per second.
        assert plant.sense().v[0] == pytest.approx(expected, abs=2e-3)


def test_joint_damping_brakes_exponentially(plant_type, make_robot):
    model = pin.Model()
    model.name = "wheel"
    joint = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "axle")
    model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), 0.1 * np.eye(3)), pin.SE3.Identity())
    robot = make_robot(model, np.zeros(1))
    plant = plant_type(robot, PlantSettings(joint_damping_nms=0.2))
    plant.reset(np.array([0.0, 3.0]))
    for _ in range(400):
        plant.step(np.zeros(1))
    # Implicit Euler, exactly: each step divides by 1 + dt d / I.
    assert plant.sense().v[0] == pytest.approx(3.0 / (1 + 1e-3 * 0.2 / 0.1) ** 400, rel=1e-12)


def test_a_limp_robot_comes_to_lie_on_its_trunk(plant_type, solo12):
    plant = plant_type(solo12)
    for _ in range(2000):
        plant.step(np.zeros(12))
    assert plant.sense().q[2] == pytest.approx(0.03, abs=1e-3)
    assert np.abs(plant.sense().v[:6]).max() < 0.02


def test_only_the_shapes_that_were_given_touch(plant_type, solo12):
    """On its back, legs up: the trunk carries it; if there is none it sinks until it hangs on its feet."""
    x = solo12.x_reference.copy()
    x[2], x[3:7], x[7:19] = 0.07, (1.0, 0.0, 0.0, 0.0), 0.0
    heights = []
    flat = Box(link="base_link", half_size_m=(0.2, 0.1, 0.06))
    for shapes in (solo12.given_shapes, (flat,), ()):
        plant = plant_type(replace(solo12, given_shapes=shapes), PlantSettings(joint_damping_nms=0.5))
        plant.reset(x)
        for _ in range(400):
            plant.step(np.zeros(12))
        heights.append(plant.sense().q[2])
        assert plant.sense().contact_forces.any() == (not shapes)
    np.testing.assert_allclose(heights[:2], (0.03, 0.06), rtol=0, atol=1e-3)
    assert heights[2] < -0.25


def test_a_fallen_anymal_lies_on_its_trunk(plant_type):
    """On its back, with the shapes of its URDF: the trunk's lid carries it, 0.1 to 0.35 m below the base's origin."""
    anymal = load_robot(
        RobotSpec(model="anymal_c", contact_frames=("LF_FOOT", "RF_FOOT", "LH_FOOT", "RH_FOOT"), armature_kg_m2=0.1)
    )
    x = anymal.x_reference.copy()
    x[2], x[3:7] = 0.5, (1.0, 0.0, 0.0, 0.0)
    plant = plant_type(anymal, PlantSettings(joint_damping_nms=5.0, rate_hz=500.0))
    plant.reset(x)
    for _ in range(750):
        plant.step(np.zeros(12))
    lying = plant.sense()
    assert 0.1 < lying.q[2] < 0.35
    assert np.abs(lying.v[:6]).max() < 0.05


def test_same_inputs_give_the_same_bits_also_after_a_reset(plant_type, solo12, hold):
    def run(plant):
        plant.reset(solo12.x_reference)
        hold(plant, solo12, 150)
        plant.set_wrench("base_link", np.array([8.0, 9.0, 0, 0, 0, 0.1]))
        hold(plant, solo12, 150)
        return plant.sense()

    plant = plant_type(solo12)
    first, again, other = run(plant), run(plant), run(plant_type(solo12))
    for name in ("time", "q", "v", "tau", "contact_forces"):
        assert np.array_equal(getattr(first, name), getattr(again, name)), name
        assert np.array_equal(getattr(first, name), getattr(other, name)), name


def test_samples_do_not_change_afterwards(plant_type, solo12, hold):
    plant = plant_type(solo12)
    hold(plant, solo12, 20)
    sample = plant.sense()
    kept = [np.array(getattr(sample, name)) for name in ("q", "v", "tau", "contact_forces")]
    hold(plant, solo12, 20)
    for name, array in zip(("q", "v", "tau", "contact_forces"), kept, strict=True):
        np.testing.assert_array_equal(getattr(sample, name), array)


def test_a_scheduled_push_gives_its_impulse(plant_type, solo12):
    """In flight: the linear momentum gained is the impulse, also of a push that begins and ends within steps."""
    plant = plant_type(solo12)
    schedule = PushSchedule(
        [Push(body="base_link", time_s=0.01234, duration_s=0.05, impulse_ns=(0.2, -0.3, 0.1))], plant.dt, plant.bodies
    )
    x = solo12.x_reference.copy()
    x[2] = 3.0
    plant.reset(x)
    for _ in range(100):
        for body, wrench in schedule.wrenches(plant.sense().time).items():
            plant.set_wrench(body, wrench)
        plant.step(np.zeros(12))
    sample = plant.sense()
    gained = momentum(solo12, sample)[0][:3] + (0, 0, solo12.mass * GRAVITY * sample.time)
    np.testing.assert_allclose(gained, (0.2, -0.3, 0.1), rtol=0, atol=2e-4)


def test_bad_states_torques_and_wrenches_are_refused(plant_type, solo12):
    plant = plant_type(solo12)
    x = solo12.x_reference.copy()
    for bad, what in ((x[:-1], r"shape \(37,\)"), (np.r_[np.nan, x[1:]], "index 0"), (np.r_[x[:3], 2 * x[3:]], "unit")):
        with pytest.raises(InputError, match=what):
            plant.reset(bad)
    for bad in (np.zeros(11), np.full(12, np.nan), np.full(12, np.inf)):
        with pytest.raises(InputError, match="tau"):
            plant.step(bad)
    with pytest.raises(InputError, match="wrench"):
        plant.set_wrench("base_link", np.zeros(3))
    with pytest.raises(InputError, match="wrench.*nan"):
        plant.set_wrench("base_link", np.array([0, 0, np.nan, 0, 0, 0]))
    for ask in (lambda: plant.set_wrench("base_lnk", np.zeros(6)), lambda: plant.body_point("base_lnk")):
        with pytest.raises(InputError, match="base_link"):
            ask()


def test_a_foot_that_is_pushed_aside_more_than_up_does_not_stand(solo12) -> None:
    forces = np.array([[0.0, 0.0, 5.0], [0.0, 0.0, 0.0], [-5.0, 0.0, 3.0], [0.0, 3.0, 5.0]])  # the third at a riser
    sample = PlantSample(0.0, np.zeros(solo12.nq), np.zeros(solo12.nv), np.zeros(solo12.nu), forces)
    assert true_state(sample).contacts.tolist() == [True, False, False, True]
