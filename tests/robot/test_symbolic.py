"""The symbolic algorithms equal Pinocchio's to 1e-10 relative, for every kind of joint, at any rotation of the base."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from lgmpc.errors import InputError, ModelError
from lgmpc.robot.symbolic import SymbolicModel

REFERENCES = [pin.LOCAL, pin.LOCAL_WORLD_ALIGNED, pin.WORLD]


def joint_wrenches(case, state) -> list[pin.Force]:
    """The external wrench at the frame, world axes, as Pinocchio takes it: in the joints' frames."""
    model, data = case.model, case.data
    pin.framesForwardKinematics(model, data, state.q)
    joint = model.frames[case.frame].parentJoint
    aligned = pin.SE3(np.eye(3), data.oMf[case.frame].translation)
    forces = [pin.Force.Zero() for _ in range(model.njoints)]
    forces[joint] = data.oMi[joint].actInv(aligned.act(pin.Force(state.wrench)))
    return forces


def test_placements(case) -> None:
    model, data = case.model, case.data
    for state in case.states():
        pin.framesForwardKinematics(model, data, state.q)
        placement = data.oMf[case.frame]
        case.check("rotation", state, placement.rotation)
        case.check("translation", state, placement.translation)
        case.check("last_joint", state, data.oMi[model.njoints - 1].translation)


@pytest.mark.parametrize("reference", REFERENCES, ids=str)
def test_frame_jacobian_and_velocity(case, reference) -> None:
    model, data = case.model, case.data
    for state in case.states():
        case.check(
            f"jacobian {reference}", state, pin.computeFrameJacobian(model, data, state.q, case.frame, reference)
        )
        pin.forwardKinematics(model, data, state.q, state.v)
        case.check(f"velocity {reference}", state, pin.getFrameVelocity(model, data, case.frame, reference).vector)


@pytest.mark.parametrize("reference", REFERENCES[:2], ids=str)
def test_classical_acceleration(case, reference) -> None:
    model, data = case.model, case.data
    for state in case.states():
        for quantity, a in (("acceleration", state.a), ("drift", np.zeros(model.nv))):
            pin.forwardKinematics(model, data, state.q, state.v, a)
            expected = pin.getFrameClassicalAcceleration(model, data, case.frame, reference).vector
            case.check(f"{quantity} {reference}", state, expected)


def test_center_of_mass(case) -> None:
    model, data = case.model, case.data
    for state in case.states():
        case.check("jacobian_com", state, pin.jacobianCenterOfMass(model, data, state.q))
        pin.centerOfMass(model, data, state.q, state.v)
        case.check("com", state, data.com[0])
        case.check("vcom", state, data.vcom[0])


def test_centroidal_momentum(case) -> None:
    model, data = case.model, case.data
    for state in case.states():
        pin.computeCentroidalMomentumTimeVariation(model, data, state.q, state.v, state.a)
        case.check("momentum", state, data.hg.vector)
        case.check("momentum_rate", state, data.dhg.vector)
        case.check("momentum_matrix", state, pin.computeCentroidalMap(model, data, state.q))


def test_momentum_rate_is_the_derivative_of_momentum(case) -> None:
    state, h = case.states(1)[0], 1e-5

    def momentum(t: float) -> np.ndarray:
        q = pin.integrate(case.model, state.q, t * state.v + 0.5 * t * t * state.a)
        return case.value("momentum", replace(state, q=q, v=state.v + t * state.a))

    case.check("momentum_rate", state, (momentum(h) - momentum(-h)) / (2 * h), 1e-6)


def test_inverse_dynamics(case) -> None:
    model, data = case.model, case.data
    for state in case.states():
        case.check("rnea", state, pin.rnea(model, data, state.q, state.v, state.a))
        pushed = pin.rnea(model, data, state.q, state.v, state.a, joint_wrenches(case, state))
        case.check("rnea_external", state, pushed)
        case.check("nle", state, pin.nonLinearEffects(model, data, state.q, state.v))
        case.check("gravity", state, pin.computeGeneralizedGravity(model, data, state.q))


def test_mass_matrix_is_pinocchios_and_symmetric_to_the_bit(case) -> None:
    for state in case.states():
        upper = np.triu(pin.crba(case.model, case.data, state.q))
        case.check("crba", state, upper + np.triu(upper, 1).T)
        mass_matrix = case.value("crba", state)
        assert (mass_matrix == mass_matrix.T).all()


def test_the_dynamics_agree(case, close) -> None:
    for state in case.states(3):
        mass_matrix = case.value("crba", state)
        case.check("rnea", state, mass_matrix @ state.a + case.value("nle", state))
        close(mass_matrix @ case.value("solved", state), np.column_stack([state.tau, state.a]))


def test_branches_leave_structural_zeros(case_named) -> None:
    symbolic, q = SymbolicModel(case_named("solo12").model), ca.SX.sym("q", 19)
    legs = 4 * 3 * 3
    assert symbolic.crba(q).nnz() == 6 * 6 + 2 * 6 * 12 + legs
    assert symbolic.frame_jacobian(q, "FR_FOOT").nnz() == 6 * (6 + 3)


@pytest.mark.parametrize(("quantity", "most"), [("rnea", 1800), ("crba", 1400), ("momentum_rate", 2000)])
def test_expressions_stay_short(case_named, quantity: str, most: int) -> None:
    """Constant zeros of the model drop out: these are instruction counts for Solo12, measured plus a few per cent."""
    assert case_named("solo12").functions[quantity].n_instructions() <= most


def test_common_parts_are_shared(case_named) -> None:
    symbolic, q = SymbolicModel(case_named("solo12").model), ca.SX.sym("q", 19)
    foot, com, both = (
        ca.Function("f", [q], outputs).n_instructions()
        for outputs in (
            [symbolic.frame_jacobian(q, "FL_FOOT")],
            [symbolic.jacobian_com(q)],
            [symbolic.frame_jacobian(q, "FL_FOOT"), symbolic.jacobian_com(q)],
        )
    )
    assert both < foot + com - 20


def test_a_result_changed_in_place_does_not_change_the_next(case_named) -> None:
    symbolic, q = SymbolicModel(case_named("iris").model), ca.SX.sym("q", 7)
    symbolic.crba(q)[0, 0] = -1
    assert float(symbolic.crba(q)[0, 0]) == pytest.approx(symbolic.mass)


def test_derivatives_are_finite_and_match_differences_in_the_tangent_space(case_named, close) -> None:
    model, state = case_named("solo12").model, case_named("solo12").states(1)[0]
    symbolic = SymbolicModel(model)
    q, dq, v, a = (ca.SX.sym(n, k) for n, k in (("q", 19), ("dq", 18), ("v", 18), ("a", 18)))
    torque = symbolic.rnea(symbolic.integrate(q, dq), v, a)
    derivative = ca.Function("d", [q, dq, v, a], [ca.jacobian(torque, dq)])(state.q, 0, state.v, state.a).full()
    expected = pin.computeRNEADerivatives(model, model.createData(), state.q, state.v, state.a)[0]
    close(derivative, expected)


def test_configurations_move_as_in_pinocchio(case_named, close) -> None:
    model, state = case_named("everything").model, case_named("everything").states(1)[0]
    symbolic = SymbolicModel(model)
    moved = symbolic.integrate(ca.DM(state.q), ca.DM(0.3 * state.v)).full().ravel()
    close(moved, pin.integrate(model, state.q, 0.3 * state.v))


def test_numeric_arguments_need_no_function(case_named, close) -> None:
    model, state = case_named("panda").model, case_named("panda").states(1)[0]
    got = SymbolicModel(model).rnea(ca.DM(state.q), ca.DM(state.v), ca.DM(state.a))
    assert isinstance(got, ca.DM)
    close(got.full().ravel(), pin.rnea(model, model.createData(), state.q, state.v, state.a))


@pytest.mark.parametrize(
    "joint", [pin.JointModelPlanar(), pin.JointModelTranslation(), pin.JointModelSphericalZYX(), pin.JointModelHX()]
)
def test_unsupported_joints_are_named(joint: object) -> None:
    model = pin.Model()
    model.addJoint(0, joint, pin.SE3.Identity(), "odd")
    with pytest.raises(ModelError, match=f"joint 'odd' is a {joint.shortname()}; supported are free-flyer"):
        SymbolicModel(model)


def test_mimic_joints_are_refused() -> None:
    model = pin.buildModelFromXML(
        """<robot name="gripper"><link name="palm"/><link name="a"/><link name="b"/>
        <joint name="one" type="prismatic"><parent link="palm"/><child link="a"/><axis xyz="1 0 0"/>
          <limit effort="1" velocity="1" lower="0" upper="1"/></joint>
        <joint name="two" type="prismatic"><parent link="palm"/><child link="b"/><axis xyz="1 0 0"/>
          <limit effort="1" velocity="1" lower="0" upper="1"/><mimic joint="one"/></joint></robot>""",
        mimic=True,
    )
    with pytest.raises(ModelError, match="'two' is a JointModelMimic"):
        SymbolicModel(model)


def test_wrong_arguments_are_named(case_named) -> None:
    symbolic, q = SymbolicModel(case_named("solo12").model), ca.SX.sym("q", 19)
    v = ca.SX.sym("v", 18)
    with pytest.raises(InputError, match="FL_FOT.*Did you mean FL_FOOT"):
        symbolic.frame_jacobian(q, "FL_FOT")
    with pytest.raises(InputError, match="frame: got 900; expected an index below"):
        symbolic.frame_placement(q, 900)
    with pytest.raises(InputError, match=r"q: got a CasADi matrix of shape \(18, 1\); expected a column of 19"):
        symbolic.com(v)
    with pytest.raises(InputError, match=r"external wrench: got shape \(4, 1\)"):
        symbolic.rnea(q, v, v, {"FL_FOOT": ca.SX.sym("f", 4)})
    with pytest.raises(InputError, match="reference: got WORLD"):
        symbolic.frame_drift(q, v, "FL_FOOT", pin.WORLD)
    with pytest.raises(InputError, match=r"dv: got .*\(12, 1\); expected a column of 18"):
        symbolic.integrate(q, ca.SX.sym("dv", 12))
