"""Robots with soles: they stand and walk, and standing the MPC makes nothing worse."""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from lgmpc import load_config
from lgmpc.actions import CentroidalAction
from lgmpc.config.build import prepare
from lgmpc.control.feet import Feet
from lgmpc.locomotion import MotionCommand
from lgmpc.locomotion.footholds import BaseMotion, FootholdPlanner
from lgmpc.locomotion.gait import biped_gaits
from lgmpc.locomotion.legs import LegGeometry, leg_inertias, leg_momentum
from lgmpc.locomotion.maps import KnownMap, KnownMapSettings
from lgmpc.locomotion.settings import LocomotionSettings, gaits_of
from lgmpc.locomotion.stepping import MappedBelief
from lgmpc.locomotion.terrain import TerrainBeliefSettings
from lgmpc.robot import leg_joints, load_robot
from lgmpc.timegrid import TimeGrid
from lgmpc.wbc import Contacts, WholeBodyController, WholeBodySettings
from tests.support.displaced import DISPLACEMENTS

PUSH = "pushes=[{{body: base_link, time_s: 0.05, duration_s: 0.2, impulse_ns: [{}, {}, 0]}}]"


@pytest.fixture(scope="module")
def legs():
    return load_robot(load_config("talos_legs_stand").robot)


def test_only_robots_whose_support_is_short_have_other_weights_standing(legs):
    solo12 = load_robot(load_config("solo12_balance").robot)
    assert legs.short_support and not solo12.short_support
    settings = WholeBodySettings()
    for robot, weight in ((legs, settings.short_support_weights.com), (solo12, settings.weights.com)):
        assert tuple(WholeBodyController(robot, settings).tasks["com"].weight) == weight


def test_the_least_normal_force_is_that_of_a_sole_and_not_of_its_corners(legs):
    """The centre of pressure of a robot that leans reaches the edge: corners carry nothing, their soles do."""
    controller = WholeBodyController(legs, WholeBodySettings())
    terms = controller.sense(legs.q_reference, np.zeros(legs.nv))
    controller.tasks["com"].target.acceleration[:] = -1.5, 0.0, 0.0  # more than the pressure at the toes gives
    controller.solve()
    normal = controller.forces[:, 2].reshape(2, 4)
    assert normal.min() == pytest.approx(0.0, abs=1e-6)
    assert (normal.sum(axis=1) > controller.contacts.lowest_normal).all()
    pressure = (normal.ravel() @ terms.contact_points[:, 0]) / normal.sum()
    assert pressure == pytest.approx(terms.contact_points[:, 0].max(), abs=2e-3)


def test_a_sole_that_just_touched_down_carries_nothing(legs):
    controller = WholeBodyController(legs, WholeBodySettings())
    controller.sense(legs.q_reference, np.zeros(legs.nv))
    controller.contacts.lowest_normal[1] = controller.contacts.highest_normal[1] = 0.0
    controller.solve()
    assert controller.status.usable and np.abs(controller.forces[4:]).max() < 1e-6


def test_a_sole_that_stands_on_its_edge_is_laid_down(legs):
    q, model, data = legs.q_reference.copy(), legs.model, legs.create_data()
    q[model.joints[model.getJointId("leg_left_6_joint")].idx_q] += 0.05
    controller = WholeBodyController(legs, WholeBodySettings())
    heights = controller.sense(q, np.zeros(legs.nv)).contact_points[:4, 2]
    controller.solve()
    pin.forwardKinematics(model, data, q, np.zeros(legs.nv), controller.acceleration)
    rises = [
        pin.getFrameClassicalAcceleration(model, data, i, pin.LOCAL_WORLD_ALIGNED).linear[2] for i in legs.contact_ids
    ]
    assert np.ptp(heights) > 5e-3
    np.testing.assert_allclose(rises[:4], -400.0 * (heights - heights.min()), atol=0.3)
    np.testing.assert_allclose(rises[4:], 0.0, atol=0.1)


def test_bounds_of_a_foots_force_are_those_of_its_points_together():
    action = CentroidalAction(5, 4, (4, 1))
    p = np.zeros(action.parameters.size)
    for name, value in {
        "contact_flags": 1.0, "contact_normals": np.tile([0.0, 0.0, 1.0], 5), "friction": 0.6, "normal_force_min": 20.0,
        "normal_force_max": 2000.0,
    }.items():  # fmt: skip
        action.parameters.view(p, name)[...] = value
    u = np.array([[0.0, 0.0, 7.0]] * 4 + [[0.0, 0.0, 25.0]]).ravel()
    bounded = action.constraint(ca.DM.zeros(9), ca.DM(u), ca.DM(p))
    parts = (bounded.value, bounded.lower, bounded.upper)
    values, lower, upper = (np.array(ca.evalf(ca.SX(part))).ravel() for part in parts)
    assert values[-1] == pytest.approx(28.0) and (lower[-1], upper[-1]) == (20.0, 2000.0)
    assert lower[4::5].tolist() == [0.0, 0.0, 0.0, 0.0, 20.0]


@pytest.mark.parametrize("speed", [-1.0, 1.0])
def test_soles_keep_apart_and_legs_do_not_cross_however_fast_the_robot_moves_sideways(legs, speed):
    planner = FootholdPlanner(LegGeometry.of(legs))
    width = legs.foot_points.size[1]
    motion = BaseMotion(0.3, -0.2, 0.1, speed, 0.4)
    ahead, left = np.array([np.cos(0.4), np.sin(0.4)]), np.array([-np.sin(0.4), np.cos(0.4)])
    other = np.array([0.3, -0.2]) + 0.03 * ahead - 0.05 * left  # the right foot, under the robot
    placed = np.array(planner.place(0, motion, 0.3, 0.4, [tuple(other)]))
    assert (placed - other) @ left > width


def test_soles_reach_as_far_as_their_legs(legs):
    """A leg ends at the ankle: with its sole as a further link no step was longer than the sway of the hips."""
    geometry = LegGeometry.of(legs)
    planner = FootholdPlanner(geometry)
    assert geometry.length == pytest.approx(0.705, abs=1e-3)  # thigh and shank
    stride = BaseMotion(0.0, 0.0, 0.6, 0.0, 0.0, commanded_vx=0.6)
    ahead, _ = planner.place(0, stride, 0.0, 0.43)
    neutral = 0.6 * np.tanh(0.215 * np.sqrt(9.81 / planner.height)) / np.sqrt(9.81 / planner.height)
    assert ahead == pytest.approx(neutral, abs=1e-3)
    assert min(planner.reach(foot, planner.highest(0.3)) for foot in range(2)) == pytest.approx(0.3)
    assert planner.highest(0.3) < planner.highest(0.2) < 0.1
    assert planner.highest(5.0) == pytest.approx(-0.1 * planner.height)  # however fast it is to go, it does not kneel


def test_soles_that_would_overlap_come_down_on_both_sides_of_the_centre_of_mass_alike(legs):
    """Beside a foot that is off the path by 2 cm the next ones would stay off it, too, and the robot sway more."""
    geometry, still = LegGeometry.of(legs), BaseMotion(0.0, 0.0, 0.0, 0.0, 0.0)
    planner, beside = FootholdPlanner(geometry), geometry.beside + 0.015
    assert geometry.beside > float(legs.foot_points.size[1])  # its shanks are wider than its soles
    places = [(0.0, 0.0), (0.0, -0.5 * beside - 0.02)]  # left, right
    for foot in (0, 1, 0):
        places[foot] = planner.place(foot, still, 0.0, 0.43, [places[1 - foot]], width=0.2)
    assert [y for _, y in places] == pytest.approx([0.5 * beside, -0.5 * beside])


def test_angular_momentum_of_legs_that_move_their_soles(legs):
    model, data, q = legs.model, legs.create_data(), legs.q_reference
    wanted = np.array([[0.4, 0.1, -0.2], [-0.3, 0.0, 0.1]])
    v, base = np.zeros(legs.nv), pin.XYZQUATToSE3(q[:7]).rotation
    for frame, velocity in zip(legs.foot_ids, wanted, strict=True):
        columns = [model.joints[joint].idx_v for joint in leg_joints(legs, frame)]
        jacobian = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)[:, columns]
        v[columns] = np.linalg.solve(jacobian, [*(base @ velocity), 0.0, 0.0, 0.0])
    expected = pin.computeCentroidalMomentum(model, data, q, v).angular
    found = base @ np.einsum("fij,fj->i", leg_inertias(legs), wanted)
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_legs_that_walk_along_a_slope_have_the_momentum_of_those_on_a_level_floor_along_it():
    """Of a swing under way and of one to come; soles rise and fall across the ground, which is left out."""
    tilted = DISPLACEMENTS["tilted"].rotation
    swings = {0: [SimpleNamespace(liftoff=-0.1, touchdown=0.2)], 1: [SimpleNamespace(liftoff=0.25, touchdown=0.4)]}
    clock = SimpleNamespace(swings=lambda foot, begin, end: swings[foot])
    places = np.zeros((8, 2, 3))
    places[:, 0, 0], places[:, 1, :2], places[5:, 1, 0] = 0.3, [-0.1, -0.2], 0.5
    found = []
    for turn in (np.eye(3), tilted):

        def sample(time, position, velocity, acceleration, turn=turn):
            velocity[:] = turn @ [1.2, 0.1, 0.2 - time]

        path = SimpleNamespace(touchdown=0.2, sample=sample)
        given = np.tile(np.eye(3), (2, 1, 1)), 0.0, clock, [path, path], places @ turn.T, turn[:, 2]
        found.append(leg_momentum(*given, np.tile(turn @ [0.6, 0.0, 0.0], (9, 1)), TimeGrid(0.05, 8)) @ turn)
    np.testing.assert_allclose(found[1], found[0], atol=1e-12)
    assert np.ptp(found[0][:, 0]) > 0.5 and np.abs(found[0][:, 2]).max() < 1e-12


def test_two_feet_walk_in_turn_and_stand_on_both_between():
    for height in (0.3, 0.9):
        gait = biped_gaits(height)["walk"]
        assert gait.min_support == 1 and gait.duty > 0.5 and abs(gait.offsets[0] - gait.offsets[1]) == 0.5
        assert gait.period_s == pytest.approx(biped_gaits(1.0)["walk"].period_s * np.sqrt(height))


def test_standing_the_mpc_makes_nothing_worse():
    """Its plan is not followed: a humanoid without and with it moves alike, to the last digit."""
    runs = []
    for enabled in ("true", "false"):
        config = load_config("talos_legs_stand", [PUSH.format(18, 5), "duration_s=0.4", f"mpc.enabled={enabled}"])
        runs.append(prepare(config).run(lambda progress: None).log)
    assert np.array_equal(runs[0].q, runs[1].q) and np.array_equal(runs[0].tau, runs[1].tau)


def test_soles_on_treads_are_put_down_half_of_a_stances_way_ahead_and_errors_are_those_of_a_pendulum(legs):
    planner = FootholdPlanner(LegGeometry.of(legs), ground=SimpleNamespace(upright=True))
    steady = BaseMotion(1.0, 0.0, 0.4, 0.0, 0.0, commanded_vx=0.4)
    late = BaseMotion(1.0, 0.0, 0.3, 0.0, 0.0, commanded_vx=0.4, error_x=-0.05)
    assert late.as_desired() == BaseMotion(1.05, 0.0, 0.4, 0.0, 0.0, commanded_vx=0.4)
    (x, _), (still, _) = (
        planner.place(0, steady, 0.3, 0.9),
        planner.place(0, BaseMotion(0.0, 0.0, 0.0, 0.0, 0.0), 0.3, 0.9),
    )
    assert x - still == pytest.approx(1.0 + 0.4 * (0.3 + 0.45), abs=1e-12)
    faster, _ = planner.place(0, BaseMotion(1.0, 0.0, 0.5, 0.0, 0.0, commanded_vx=0.4), 0.3, 0.9)
    rate = np.sqrt(9.81 / planner.height)
    gain = np.tanh(0.45 * rate) / rate + 1.0 / (rate * np.sinh(0.9 * rate))
    assert faster - x == pytest.approx(0.1 * (0.3 + gain), abs=1e-3)


def test_soles_on_a_map_are_level_on_one_tread_and_beside_each_other(legs):
    geometry, pose = LegGeometry.of(legs), np.array([0.0, 0.0, 0.9, 0.0, 0.0, 0.0, 1.0])
    stairs = KnownMap(
        lambda points: 0.1 * np.maximum(np.floor((points[:, 0] - 0.2) / 0.3) + 1.0, 0.0),
        KnownMapSettings(), geometry.scale, np.random.default_rng(0),
    )  # fmt: skip
    belief = MappedBelief(legs.foot_points, geometry, TerrainBeliefSettings(), stairs, pose)
    belief.begin(np.zeros((legs.nc, 3)))
    belief.look(0.0, BaseMotion(0.0, 0.0, 0.4, 0.0, 0.0, commanded_vx=0.4))
    planner = FootholdPlanner(geometry)
    for nominal in np.linspace(0.3, 0.9, 13):
        place, normal = belief.choose(
            planner, BaseMotion(0.0, 0.0, 0.4, 0.0, 0.0), [0], np.array([[nominal, 0.0]]), np.zeros(1), 0.9,
            np.array([[nominal - 0.3, -0.05]]),
        )  # fmt: skip
        tread = np.floor((place[0, 0] - 0.2) / 0.3)
        ends = place[0, 0] + 0.5 * geometry.sole[0] * np.array([-1.0, 1.0])
        assert (np.floor((ends - 0.2) / 0.3) == tread).all() and place[0, 2] == pytest.approx(0.1 * (tread + 1.0))
        assert normal.tolist() == [[0.0, 0.0, 1.0]] and place[0, 1] + 0.05 > geometry.sole[1]
    below = belief.under(0, [-0.2, 0.1, 0.0], [0.35, 0.1, 0.1])  # the toe is above the next tread before it is there
    assert below[4] == pytest.approx(0.0) and below[-2] == pytest.approx(0.1) and (np.diff(below) >= 0.0).all()


@pytest.mark.slow
def test_talos_climbs_stairs_on_level_soles_with_its_trunk_upright():
    near = ["world={kind: stairs_10cm, tread_m: 0.3, ahead_m: 0.6, steps: 2}", "duration_s=3.6"]
    first = "{at_s: 0.2, velocity_m_s: [0.3, 0, 0], gait: walk, height_m: -0.04}"
    commands = f"{first}, {{at_s: 0.9, velocity_m_s: [0.4, 0, 0], gait: climb, height_m: -0.08}}"
    result = prepare(load_config("talos_stairs", [*near, f"commands=[{commands}]"])).run(lambda progress: None)
    log = result.log
    rotations = [pin.Quaternion(pose).matrix()[2, 2] for pose in log.base_pose[:, 3:]]
    assert np.degrees(np.arccos(min(rotations))) < 3.0
    points, stands = log.contact_points.reshape(log.ticks, 2, 4, 3), log.stance > 0
    heights = points[stands][..., 2]
    assert np.abs(heights - 0.1 * np.round(heights / 0.1)).max() < 5e-3 and heights.max() > 0.19
    assert result.certificate is not None and result.certificate.certified, result.certificate


@pytest.mark.slow
def test_g1_walks_fast_with_its_base_low_on_flat_soles_that_do_not_meet():
    """As high as it stands, its knees are stretched at 0.8 m/s: it falls after 1.3 s."""
    commands = "commands=[{at_s: 0.2, velocity_m_s: [0.3, 0, 0], gait: walk}, {at_s: 1.2, velocity_m_s: [0.8, 0, 0]}]"
    config = load_config("g1_walk", [commands, "duration_s=3.5"])
    log = prepare(config).run(lambda progress: None).log
    points = log.contact_points.reshape(log.ticks, 2, 4, 3)
    centres = points.mean(axis=2)
    walking = log.time > 2.4
    assert (log.momentum[walking, 0] / log.mass_kg).mean() == pytest.approx(0.8, abs=0.03)
    assert log.com[walking, 2].max() < log.com[0, 2] - 0.02 and log.tilt_deg.max() < 5.0
    assert (centres[:, 0, 1] - centres[:, 1, 1]).min() > 0.06  # soles are 0.06 m wide
    normals = np.cross(points[:, :, 1] - points[:, :, 3], points[:, :, 0] - points[:, :, 2])
    tilt = np.degrees(np.arccos(np.abs(normals[..., 2]) / np.linalg.norm(normals, axis=-1)))
    assert tilt.max() < 3.0  # 2.2 measured
    assert log.stance.shape == (log.ticks, 2) and not log.stance.all()


@pytest.mark.parametrize(("height", "rough"), [(0.005, False), (0.015, True)])
def test_soles_that_land_a_hundredth_of_the_height_off_tell_of_rough_ground(legs, height, rough):
    """Soles clear a third of what point feet clear: 3 % of the whole height (26 mm) are as high as their swings."""
    settings, whole = LocomotionSettings(), WholeBodySettings().scaled(legs)
    feet = Feet(legs, settings, gaits_of(legs, settings), Contacts.standing(legs, whole))
    corners = feet.points.place(feet.legs.feet * [1.0, 1.0, 0.0], np.zeros(2), feet.ground.normals)
    feet.begin(0.0, corners, None)
    ground = np.zeros(2)
    for time in 1e-3 * np.arange(1, 900):
        feet.follow(time, MotionCommand(vx=0.1, gait="walk"))
        touching = feet.clock.flags(time)
        touching[0] |= feet.velocity[0, 2] < 0.0 and feet.position[0, 2] < height
        ground[0] = ground[0] if feet.stance[0] else height  # a block below its first swing
        corners[:, 2] = feet.points.spread(np.where(feet.stance, ground, feet.position[:, 2]))
        still = BaseMotion(0.0, 0.0, 0.0, 0.0, 0.0)
        feet.update(time, corners, np.zeros_like(corners), feet.points.spread(touching), still)
    assert (feet.roughness > 0.0) == rough


@pytest.mark.slow
def test_legs_without_a_trunk_walk_on_soles_that_hardly_turn():
    """Nothing balances their yaw momentum: with `wbc.joint_horizon_s` of 0.02 a sole slides by 5.5 mm of 5."""
    result = prepare(load_config("talos_legs_walk")).run(lambda progress: None)
    assert result.verdict.passed, result.verdict.reasons
    assert result.certificate is not None and result.certificate.certified


@pytest.mark.slow
def test_g1_follows_commands_that_change_within_a_step():
    """With `wbc.joint_horizon_s` of 0.02 and 1 m/s2 it falls at 2.1 s: with its waist at a limit before the second.

    Its wrists swing through its thighs, which neither plant prevents.
    """
    result = prepare(load_config("g1_random_commands", ["duration_s=2.1"])).run(lambda progress: None)
    assert result.log.tilt_deg.max() < 4.0
    assert result.certificate is not None
    assert [each.name for each in result.certificate.broken] == ["self-penetration"]


@pytest.mark.slow
def test_talos_walks_on_through_a_push_and_brakes_its_joints_before_their_limits():
    """Pushed ahead just before a lift-off it lands 0.2 m ahead; a leg braked at its limits carries nothing then."""
    push = "pushes=[{body: torso_2_link, time_s: 2.3815, duration_s: 0.2, impulse_ns: [27, 0, 0]}]"
    log = prepare(load_config("talos_walk_push", [push, "duration_s=3.6"])).run(lambda progress: None).log
    assert log.tilt_deg.max() < 6.0 and (log.wbc_status == log.wbc_status[0]).all()
    centres = log.contact_points.reshape(log.ticks, 2, 4, 3).mean(axis=2)
    assert (centres[:, 0, 1] - centres[:, 1, 1]).min() > 0.125  # soles are 0.124 m wide
    assert log.momentum[-1, 0] / log.mass_kg == pytest.approx(0.3, abs=0.1)


@pytest.mark.slow
def test_talos_walks_on_its_sensors_and_knows_which_sole_carries():
    commands = "commands=[{at_s: 0.2, velocity_m_s: [0.4, 0, 0], gait: walk}]"
    result = prepare(load_config("talos_walk_inekf", [commands, "duration_s=2.5"])).run(lambda progress: None)
    log, walking = result.log, result.metrics.walking
    assert walking.odometry_drift_percent < 2.0 and walking.walking_tilt_deg < 1.0
    found = log.estimate_contacts.astype(bool)
    carries = log.of_feet(np.add, log.normal_forces) > 1.0
    assert (found != carries).mean() < 0.03  # with a force for each corner alone, of one tick, 0.1


@pytest.mark.slow
@pytest.mark.parametrize("impulse", [(45, 0), (0, 45), (-40, 0)])
def test_talos_steps_against_a_push_on_its_torso_and_stays_upright(impulse):
    push = f"pushes=[{{body: torso_2_link, time_s: 0.1, duration_s: 0.2, impulse_ns: [{impulse[0]}, {impulse[1]}, 0]}}]"
    config = load_config("talos_push_steps", [push, "duration_s=1.8"])
    log = prepare(config).run(lambda progress: None).log
    stance = log.stance.astype(bool)
    assert (~stance).any(axis=0).all() and stance.any(axis=1).all()  # both feet step, in turn
    upright = 1.0 - 2.0 * (log.q[:, 3] ** 2 + log.q[:, 4] ** 2)
    assert np.degrees(np.arccos(upright)).max() < 12.0
    assert np.abs(log.momentum[-1, :2]).max() / log.mass_kg < 0.4
    assert (log.wbc_status == log.wbc_status[0]).all()


@pytest.mark.slow
def test_bolt_keeps_itself_up_on_two_points_by_stepping():
    push = "pushes=[{body: base_link, time_s: 1.0, duration_s: 0.1, impulse_ns: [0.0, 0.3, 0.0]}]"
    result = prepare(load_config("bolt_step", [push, "duration_s=3.0"])).run(lambda progress: None)
    log, walking = result.log, result.metrics.walking
    assert not result.metrics.fell and walking.walking_tilt_deg < 10.0 and walking.recovery_time_s < 1.0
    left, right = log.foot_centres.transpose(1, 0, 2)
    assert (left - right)[:, 1].min() > 0.1  # of 0.2 m: its legs do not cross


@pytest.mark.slow
def test_talos_leans_to_reach_and_holds_its_hand_against_a_pull():
    """Its trunk leans, its hips go back, its centre of mass stays above its soles."""
    config = load_config("talos_reach_stand", ["duration_s=5.3", "wbc.hands.0.moves.1.at_s=5.2"])
    log = prepare(config).run(lambda progress: None).log
    ends = log.time > 4.4
    assert np.linalg.norm(log.hand_poses[ends, 0, :2] - [0.7, 0.2], axis=1).max() < 0.005
    toes = log.contact_points[0, :, 0].max()
    assert log.hand_poses[-1, 0, 0] > toes + 0.6 and np.abs(log.com[ends, 0] - log.com[0, 0]).max() < 0.03
    assert log.tilt_deg[ends].min() > 10.0 and (log.wbc_status == log.wbc_status[0]).all()
