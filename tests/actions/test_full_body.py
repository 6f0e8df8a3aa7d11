from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from lgmpc.actions import (
    Contact,
    ContactForwardDynamics,
    ExternalWrench,
    FreeForwardDynamics,
    ImpulseAction,
    MultibodyAction,
    Unknowns,
    thrusters,
)
from lgmpc.actions.dynamics import Dynamics
from lgmpc.costs import ConstraintItem, CostItem, ParameterLayout, QuadraticBarrier
from lgmpc.costs.library import ContactForce, Control, FrameTranslation, FrictionCone, JointAcceleration, StateError
from lgmpc.errors import InputError
from lgmpc.ocp import check_derivatives
from lgmpc.robot import Robot, RobotSpec, load_robot

FEET = ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT")


@lru_cache
def solo() -> Robot:
    return load_robot(
        RobotSpec(
            model="solo12",
            contact_frames=FEET,
            effort_limit_nm=1.8,
            velocity_limit_rad_s=30.0,
            position_limit_rad=(-3.0, 3.0),
            armature_kg_m2=3.6e-4,
        )
    )


@lru_cache
def forward(contacts: tuple[str | Contact, ...] = FEET) -> ContactForwardDynamics:
    return ContactForwardDynamics(solo().model, contacts)


def body(mass: float = 1.5) -> pin.Model:
    model = pin.Model()
    root = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root")
    inertia = pin.Inertia(mass, np.array([0.1, 0.05, -0.02]), np.diag([0.1, 0.2, 0.25]))
    model.appendBodyToJoint(root, inertia, pin.SE3.Identity())
    return model


def motion_function(dynamics: Dynamics, frames: tuple[str, ...] = ()) -> tuple[ca.Function, ParameterLayout]:
    """(q, v, u, p) -> (a, forces)."""
    layout = ParameterLayout(*dynamics.parameters)
    q, v = ca.SX.sym("q", dynamics.model.nq), ca.SX.sym("v", dynamics.model.nv)
    u, p = ca.SX.sym("u", dynamics.nu), ca.SX.sym("p", layout.size)
    motion = dynamics.motion(q, v, u, layout.split(p), Unknowns())
    forces = ca.vertcat(ca.SX(0, 1), *(motion.forces[frame] for frame in frames))
    return ca.Function("motion", [q, v, u, p], [motion.a, forces]), layout


def point(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A random state near the reference posture, and torques."""
    x = forward().state.integrate(solo().x_reference, rng.uniform(-0.5, 0.5, 36))
    return x, rng.standard_normal(12)


def random_parameters(layout: ParameterLayout, rng: np.random.Generator, **values: object) -> np.ndarray:
    p = layout.default.copy()
    for name in ("contact_points", "contact_gains"):
        p[layout[name]] = rng.uniform(0.1, 1.0, p[layout[name]].size)
    for name, value in values.items():
        p[layout[name]] = value
    return p


def oracle(x: np.ndarray, u: np.ndarray, layout: ParameterLayout, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Accelerations and forces from Pinocchio's kinematics and a dense solve, with the contacts in use only."""
    model, data = solo().model, solo().create_data()
    q, v, s = x[:19], x[19:], layout.split(p)
    pin.computeAllTerms(model, data, q, v)
    pin.forwardKinematics(model, data, q, v, np.zeros(18))
    pin.updateFramePlacements(model, data)
    used = [i for i in range(4) if s["contact_flags"][i] == 1.0]
    jacobian, target = [np.zeros((0, 18))], [np.zeros(0)]
    for i in used:
        frame, axes = solo().frame(FEET[i]), pin.LOCAL_WORLD_ALIGNED
        rows = pin.getFrameJacobian(model, data, frame, axes)[:3]
        drift = pin.getFrameClassicalAcceleration(model, data, frame, axes).linear
        error = data.oMf[frame].translation - s["contact_points"][3 * i : 3 * i + 3]
        jacobian.append(rows)
        stiffness, damping = s["contact_gains"][2 * i : 2 * i + 2]
        target.append(-drift - stiffness * error - damping * rows @ v)
    j = np.vstack(jacobian)
    mass = data.M.copy()
    kkt = np.block([[mass, -j.T], [j, np.zeros((len(j), len(j)))]])
    solution = np.linalg.solve(kkt, np.r_[np.r_[np.zeros(6), u] - data.nle, np.concatenate(target)])
    forces = np.zeros((4, 3))
    forces[used] = solution[18:].reshape(-1, 3)
    return solution[:18], forces.ravel()


@pytest.mark.parametrize("flags", [(1, 1, 1, 1), (1, 0, 0, 1), (0, 0, 1, 0), (0, 0, 0, 0)])
def test_contact_dynamics_agree_with_pinocchio_for_all_flags(flags: tuple[int, ...]) -> None:
    function, layout = motion_function(forward(), FEET)
    rng = np.random.default_rng(0)
    for _ in range(3):
        x, u = point(rng)
        p = random_parameters(layout, rng, contact_flags=flags)
        a, forces = (v.full().ravel() for v in function(x[:19], x[19:], u, p))
        expected_a, expected_f = oracle(x, u, layout, p)
        np.testing.assert_allclose(a, expected_a, rtol=0, atol=1e-10 * max(1.0, np.abs(expected_a).max()))
        np.testing.assert_allclose(forces, expected_f, rtol=0, atol=1e-10 * max(1.0, np.abs(expected_f).max()))
        assert not forces.reshape(4, 3)[np.array(flags) == 0].any()  # exactly
    if not any(flags):
        free = pin.aba(solo().model, solo().create_data(), x[:19], x[19:], np.r_[np.zeros(6), u])
        np.testing.assert_allclose(a, free, rtol=0, atol=1e-10 * np.abs(free).max())


def test_stretched_legs_leave_the_contacts_regular() -> None:
    """The hip's axes and the straight leg make each leg's own Jacobian singular; that of the whole robot is not."""
    function, layout = motion_function(forward(), FEET)
    q = solo().q_reference.copy()
    q[7:] = 0.0
    a, forces = (v.full().ravel() for v in function(q, np.zeros(18), np.zeros(12), layout.default))
    assert np.isfinite(a).all() and np.isfinite(forces).all()
    assert forces.reshape(4, 3)[:, 2].sum() == pytest.approx(9.81 * solo().mass, rel=1e-6)  # carried by straight legs


def test_surface_contact_holds_position_and_orientation() -> None:
    model = solo().model
    dynamics = forward((Contact("FL_FOOT", 6), "HR_FOOT"))
    function, layout = motion_function(dynamics, ("FL_FOOT", "HR_FOOT"))
    rng = np.random.default_rng(1)
    x, u = point(rng)
    a, forces = (v.full().ravel() for v in function(x[:19], x[19:], u, layout.default))
    assert forces.shape == (9,)
    data = model.createData()
    pin.forwardKinematics(model, data, x[:19], x[19:], a)
    for frame, size in (("FL_FOOT", 6), ("HR_FOOT", 3)):
        index = solo().frame(frame)
        acceleration = pin.getFrameClassicalAcceleration(model, data, index, pin.LOCAL_WORLD_ALIGNED).vector
        np.testing.assert_allclose(acceleration[:size], 0.0, atol=1e-9)
    external = [pin.Force.Zero() for _ in range(model.njoints)]
    pin.updateFramePlacements(model, data)
    for frame, wrench in (("FL_FOOT", forces[:6]), ("HR_FOOT", np.r_[forces[6:], 0, 0, 0])):
        info = model.frames[solo().frame(frame)]
        turn = pin.SE3(data.oMf[solo().frame(frame)].rotation, np.zeros(3))
        external[info.parentJoint] = info.placement.act(turn.actInv(pin.Force(wrench)))
    torques = pin.rnea(model, data, x[:19], x[19:], a, external)
    np.testing.assert_allclose(torques, np.r_[np.zeros(6), u], rtol=0, atol=1e-9)


WHEEL = Contact("HL_FOOT", 2, axes=((0.0, 0.0, 2.0),), frame_axes=((0.0, 1.0, 0.0),))
SOME_AXES = (Contact("FL_FOOT", 1), Contact("FR_FOOT", 2), WHEEL, Contact("HR_FOOT", 1, axes=((0.6, 0.0, 0.8),)))


@pytest.mark.parametrize("flags", [(1, 1, 1, 1), (0, 1, 1, 0)])
def test_contacts_of_some_axes_hold_these_and_push_along_them(flags: tuple[int, ...]) -> None:
    """Along a motion with the accelerations found, held velocities change as Baumgarte's terms require.

    By central differences of Pinocchio's frame velocities; forces satisfy its equations of motion.
    """
    model, data = solo().model, solo().create_data()
    frames = tuple(contact.frame for contact in SOME_AXES)
    function, layout = motion_function(forward(SOME_AXES), frames)
    rng, h = np.random.default_rng(12), 1e-5
    x, u = point(rng)
    q, v = x[:19], x[19:]
    gains = rng.uniform(0.5, 3.0, 8)
    p = random_parameters(layout, rng, contact_flags=flags, contact_gains=gains)
    points = p[layout["contact_points"]].reshape(4, 3)
    a, forces = (value.full().ravel() for value in function(q, v, u, p))
    forces = forces.reshape(4, 3)

    def held_velocities(time: float) -> list[np.ndarray]:
        there = pin.integrate(model, q, time * v + time**2 / 2 * a)
        pin.forwardKinematics(model, data, there, v + time * a)
        found = []
        for contact in SOME_AXES:
            frame = solo().frame(contact.frame)
            rotation = pin.updateFramePlacement(model, data, frame).rotation
            axes = [np.array(n) for n in contact.axes] + [rotation @ n for n in contact.frame_axes]
            found.append(np.array(axes) @ pin.getFrameVelocity(model, data, frame, pin.LOCAL_WORLD_ALIGNED).linear)
        return found

    before, now, after = (held_velocities(time) for time in (-h, 0.0, h))
    pin.framesForwardKinematics(model, data, q)
    external = [pin.Force.Zero() for _ in range(model.njoints)]
    for i, contact in enumerate(SOME_AXES):
        frame = model.frames[solo().frame(contact.frame)]
        placement = data.oMf[solo().frame(contact.frame)]
        world, own = (np.array(axes).reshape(-1, 3) for axes in (contact.axes, contact.frame_axes))
        if flags[i]:
            place = np.r_[world @ (placement.translation - points[i]), np.zeros(len(own))]
            rate = (after[i] - before[i]) / (2 * h) + gains[2 * i] * place + gains[2 * i + 1] * now[i]
            np.testing.assert_allclose(rate, 0.0, atol=1e-5 * max(1.0, np.abs(a).max()))
        directions = np.vstack([world, own @ placement.rotation.T])
        across = forces[i] - directions.T @ np.linalg.lstsq(directions.T, forces[i], rcond=None)[0]
        np.testing.assert_allclose(across, 0.0, atol=1e-9)
        assert np.any(forces[i]) == bool(flags[i])
        turn = pin.SE3(placement.rotation, np.zeros(3))
        external[frame.parentJoint] = frame.placement.act(turn.actInv(pin.Force(forces[i], np.zeros(3))))
    torques = pin.rnea(model, data, q, v, a, external)
    np.testing.assert_allclose(torques, np.r_[np.zeros(6), u], rtol=0, atol=1e-8)


def test_axes_that_do_not_suit_a_contact_are_named() -> None:
    with pytest.raises(InputError, match="size: got 4; expected 1 or 2 for some axes, 3 for a point, 6"):
        Contact("foot", 4)
    with pytest.raises(InputError, match="axes, frame_axes: got 1 axes; expected 2 in all"):
        Contact("foot", 2, axes=((0.0, 0.0, 1.0),))
    with pytest.raises(InputError, match="got 1 axes; expected none for a contact of size 3"):
        Contact("foot", 3, frame_axes=((0.0, 0.0, 1.0),))
    with pytest.raises(InputError, match=r"axes: got \(\(0.0, 0.0, 0.0\),\); expected directions"):
        Contact("foot", 1, axes=((0.0, 0.0, 0.0),))
    with pytest.raises(InputError, match="expected two directions that are not parallel"):
        Contact("foot", 2, axes=((0.0, 0.0, 1.0), (0.0, 0.0, -2.0)))
    with pytest.raises(InputError, match=r"axes: got \(0, 0, 1\); expected directions of three numbers"):
        Contact("foot", 1, axes=(0, 0, 1))  # type: ignore[arg-type]


def stance_action() -> MultibodyAction:
    dynamics = forward()
    costs = [
        CostItem("x", StateError(dynamics.state, solo().x_reference), weight=np.linspace(0.5, 2.0, 36)),
        CostItem("u", Control(12), weight=1e-2),
        CostItem("acceleration", JointAcceleration(12), weight=1e-4),
        *(CostItem(f"cone_{f}", FrictionCone(f, 6), 0.1, QuadraticBarrier(0.0, np.inf)) for f in FEET),
        *(CostItem(f"force_{f}", ContactForce(f), 1e-3) for f in FEET),
        CostItem("foot", FrameTranslation(FEET[0])),
    ]
    bounds = [ConstraintItem(f"friction_{FEET[0]}", FrictionCone(FEET[0], 4), 0.0, np.inf)]
    return MultibodyAction("stance", dynamics, costs, bounds)


def test_derivatives_of_the_full_body_stage() -> None:
    action = stance_action()
    rng = np.random.default_rng(2)
    for flags in ((1, 1, 1, 1), (0, 1, 1, 0)):
        p = random_parameters(action.parameters, rng, contact_flags=flags, contact_damping=1e-3)
        report = check_derivatives(action, rng, parameters=p, points=2)
        assert report.passed, str(report)


def test_an_external_wrench_changes_the_centroidal_momentum_at_its_rate() -> None:
    model, data = solo().model, solo().create_data()
    dynamics = ContactForwardDynamics(model, FEET, [ExternalWrench(model)])
    motion, layout = motion_function(dynamics, FEET)
    rng = np.random.default_rng(11)
    x, u = point(rng)
    wrench = np.array([3.0, -2.0, 1.0, 0.2, 0.5, -0.3])
    p = random_parameters(layout, rng, contact_flags=[1, 1, 0, 1], external_wrench=wrench)
    a, forces = (value.full().ravel() for value in motion(x[:19], x[19:], u, p))
    rate = pin.computeCentroidalMomentumTimeVariation(model, data, x[:19], x[19:], a).vector
    pin.framesForwardKinematics(model, data, x[:19])
    arms = [data.oMf[solo().frame(foot)].translation - data.com[0] for foot in FEET]
    loads = forces.reshape(4, 3)
    expected = np.r_[loads.sum(axis=0) + solo().mass * solo().gravity, np.cross(arms, loads).sum(axis=0)] + wrench
    np.testing.assert_allclose(rate, expected, rtol=0, atol=1e-11)
    action = MultibodyAction("pushed", dynamics, [CostItem("force", ContactForce(FEET[0]))])
    p = random_parameters(action.parameters, rng, external_wrench=wrench)
    report = check_derivatives(action, rng, parameters=p, points=1)
    assert report.passed, str(report)
    with pytest.raises(InputError, match="model: got .* whose base is fixed"):
        ExternalWrench(pin.buildSampleModelManipulator())


def test_gauss_newton_hessian_is_that_of_the_weighted_residuals() -> None:
    """Squared in the unknowns or directly, the Hessian is J^T W J: compare with finite differences of the residuals."""
    dynamics = forward()
    cones = [CostItem(f"cone_{f}", FrictionCone(f, 6), [1, 2, 3, 4, 5, 6, 7]) for f in FEET]  # squared in the forces
    action = MultibodyAction("cones", dynamics, cones)
    as_bounds = MultibodyAction("rows", dynamics, (), [ConstraintItem(c.name, c.residual) for c in cones])
    rng = np.random.default_rng(3)
    x, u = point(rng)
    p = random_parameters(action.parameters, rng)
    names = action.quadratic_function.name_out()
    cost = dict(zip(names, action.quadratic_function(x, u, x, p), strict=True))
    q = as_bounds.parameters.default.copy()
    for name in (*(p.name for p in dynamics.parameters), "duration", *(f"cone_{f}_friction" for f in FEET)):
        q[as_bounds.parameters[name]] = p[action.parameters[name]]
    rows = dict(zip(names, as_bounds.quadratic_function(x, u, x, q), strict=True))
    jacobian = np.hstack([rows["C"].full(), rows["D"].full()])
    weight = np.tile([1, 2, 3, 4, 5, 6, 7], 4) * 0.01
    expected = jacobian.T @ (weight[:, None] * jacobian)
    got = np.block([[cost["Q"].full(), cost["S"].full().T], [cost["S"].full(), cost["R"].full()]])
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
    values = as_bounds.evaluate(x, u, q).constraint
    gradient = np.r_[cost["q"].full().ravel(), cost["r"].full().ravel()]
    np.testing.assert_allclose(gradient, jacobian.T @ (weight * values), rtol=0, atol=1e-12 * np.abs(gradient).max())


def test_running_costs_are_multiplied_by_the_duration_and_terminal_ones_are_not() -> None:
    action = MultibodyAction(
        "costs", forward(), [CostItem("x", StateError(forward().state)), CostItem("u", Control(12))]
    )
    x, u = point(np.random.default_rng(4))
    p = action.parameters.default.copy()
    p[action.parameters["duration"]] = 0.02
    error = action.state.diff(action.state.neutral(), x)
    assert action.evaluate(x, u, p).cost == pytest.approx(0.02 * (error @ error + u @ u) / 2)
    assert float(action.terminal_value_function(x, p)) == pytest.approx(error @ error / 2)


def test_impact_agrees_with_pinocchio_and_loses_energy() -> None:
    action = ImpulseAction("impact", solo().model, FEET, [CostItem("push", ContactForce(FEET[0]))])
    rng = np.random.default_rng(6)
    x, _ = point(rng)
    model, data = solo().model, solo().create_data()
    p = action.parameters.default.copy()
    p[action.parameters["contact_flags"]] = [1, 0, 0, 1]
    p[action.parameters["restitution"]] = 0.2
    jacobian = np.vstack(
        [pin.computeFrameJacobian(model, data, x[:19], solo().frame(f), pin.LOCAL_WORLD_ALIGNED)[:3]
         for f in (FEET[0], FEET[3])]
    )  # fmt: skip
    after = action.evaluate(x, np.zeros(0), p).x_next
    np.testing.assert_array_equal(after[:19], x[:19])
    mass = pin.crba(model, data, x[:19])
    mass = np.triu(mass) + np.triu(mass, 1).T
    kkt = np.block([[mass, -jacobian.T], [jacobian, np.zeros((6, 6))]])
    expected = np.linalg.solve(kkt, np.r_[mass @ x[19:], -0.2 * jacobian @ x[19:]])
    np.testing.assert_allclose(after[19:], expected[:18], rtol=0, atol=1e-10)
    assert action.evaluate(x, np.zeros(0), p).cost == pytest.approx(expected[18:21] @ expected[18:21] / 2)
    assert after[19:] @ mass @ after[19:] < x[19:] @ mass @ x[19:]
    report = check_derivatives(action, rng, parameters=p, points=1)
    assert report.passed, str(report)


def test_hovering_quadrotor_stays() -> None:
    model = body(1.2)
    model.inertias[1] = pin.Inertia(1.2, np.zeros(3), np.diag([0.01, 0.01, 0.02]))
    arms = 0.2 * np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]])
    actuation = thrusters(model, arms, np.tile([0.0, 0, 1], (4, 1)), [0.02, -0.02, 0.02, -0.02])
    action = MultibodyAction("quadrotor", FreeForwardDynamics(model, actuation))
    x = action.state.neutral()
    hover = np.full(4, 1.2 * 9.81 / 4)
    np.testing.assert_allclose(action.evaluate(x, hover, action.parameters.default).x_next, x, rtol=0, atol=1e-14)
    turned = action.evaluate(x, hover + [0.1, -0.1, 0.1, -0.1], action.parameters.default).x_next
    np.testing.assert_allclose(turned[7:], [0, 0, 0, 0, 0, 0.01 * 0.4 * 0.02 / 0.02], rtol=0, atol=1e-14)


def test_quadratic_drag_takes_energy() -> None:
    model = body()
    model.gravity = pin.Motion.Zero()
    function, layout = motion_function(FreeForwardDynamics(model, np.eye(6)))
    q, v, p = pin.neutral(model), np.random.default_rng(7).standard_normal(6), layout.default.copy()
    p[layout["drag_quadratic"]] = 0.5
    power = v @ model.inertias[1].matrix() @ function(q, v, np.zeros(6), p)[0].full().ravel()
    assert power == pytest.approx(-0.5 * (np.abs(v) ** 3).sum())


def test_arm_agrees_with_aba() -> None:
    model = pin.buildSampleModelManipulator()
    dynamics = FreeForwardDynamics(model)
    function, layout = motion_function(dynamics)
    rng = np.random.default_rng(8)
    q, v, tau = rng.uniform(-1, 1, model.nq), rng.standard_normal(model.nv), rng.standard_normal(model.nv)
    expected = pin.aba(model, model.createData(), q, v, tau)
    np.testing.assert_allclose(function(q, v, tau, layout.default)[0].full().ravel(), expected, rtol=1e-10)


def test_bad_input_is_named() -> None:
    model = solo().model
    with pytest.raises(InputError, match="Did you mean FL_FOOT"):
        ContactForwardDynamics(model, ["FL_FOT"])
    with pytest.raises(InputError, match="contacts: got FL_FOOT twice"):
        ContactForwardDynamics(model, ["FL_FOOT", Contact("FL_FOOT", 6)])
    with pytest.raises(InputError, match="contacts: got none"):
        ImpulseAction("impact", model, [])
    with pytest.raises(InputError, match="size: got 4"):
        Contact("FL_FOOT", 4)
    with pytest.raises(InputError, match="name: got 'my action'"):
        MultibodyAction("my action", forward())
    with pytest.raises(InputError, match=r"actuation: got shape \(3, 3\)"):
        FreeForwardDynamics(model, np.eye(3))
    with pytest.raises(InputError, match="directions: got vectors of other lengths"):
        thrusters(model, np.zeros((1, 3)), np.ones((1, 3)))
    with pytest.raises(InputError, match="Did you mean FL_FOOT"):
        MultibodyAction("a", forward(), [CostItem("f", ContactForce("FL_FOTO"))]).quadratic_function  # noqa: B018
