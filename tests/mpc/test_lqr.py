from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lgmpc.errors import InputError
from lgmpc.locomotion.horizon import ContactHorizon, MotionReference
from lgmpc.mpc import (
    CentroidalLqr,
    CentroidalMpc,
    CentroidalMpcSettings,
    CentroidalWeights,
    LqrSettings,
    MeasuredState,
    MpcStatus,
    Plan,
    TrackingWeights,
    linearize_centroidal,
)

MASS = 2.5
FEET = np.array([[0.2, 0.15, 0.0], [0.2, -0.15, 0.0], [-0.2, 0.15, 0.0], [-0.2, -0.15, 0.0]])
STANDING = np.array([0.0, 0.0, 0.24, 0, 0, 0, 0, 0, 0])
WEIGHT = np.array([0.0, 0.0, MASS * 9.81])


def horizon(points: np.ndarray, flags: np.ndarray, friction: float = 0.6, nodes: int = 20) -> ContactHorizon:
    """One value for all intervals, or one each."""
    contacts = ContactHorizon.allocate(nodes, 4)
    contacts.hold(points, flags, friction)
    return contacts


def motion(reference: np.ndarray, nodes: int = 20) -> MotionReference:
    """The motion of a level base with [centre of mass; linear momentum; ...] (9,), or (N+1, 9) a node each."""
    rows = np.tile(reference, (nodes + 1, 1)) if reference.ndim == 1 else reference
    level = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (len(rows), 1))
    return MotionReference(rows[:, :3], rows[:, 3:6] / MASS, level, np.zeros((len(rows), 3)))


def update(lqr: CentroidalLqr | CentroidalMpc, t: float, x: np.ndarray, **change: object) -> Plan:
    given = {"points": FEET, "flags": np.ones(4, dtype=bool), "friction": 0.6, "reference": STANDING, **change}
    nodes = lqr.settings.nodes
    contacts = horizon(given["points"], given["flags"], given["friction"], nodes)
    wrench = np.broadcast_to(change.get("wrench", np.zeros(6)), (nodes, 6))
    state = MeasuredState.centroidal(t, x[:3], x[3:9])
    return lqr.update(state, contacts, motion(given["reference"], nodes), wrench)


def rates(x: np.ndarray, forces: np.ndarray, wrench: np.ndarray) -> np.ndarray:
    """The nonlinear centroidal dynamics."""
    moment = np.cross(FEET - x[:3], forces).sum(axis=0)
    return np.r_[x[3:6] / MASS, forces.sum(axis=0) - WEIGHT + wrench[:3], moment + wrench[3:]]


def test_linear_model_is_the_derivative_of_the_nonlinear_one_over_an_interval() -> None:
    h, share = 0.02, np.tile(WEIGHT / 4, (4, 1))
    model = linearize_centroidal(MASS, WEIGHT, FEET - STANDING[:3], np.ones(4), h)

    def flow(dx: np.ndarray, du: np.ndarray, w: np.ndarray) -> np.ndarray:
        done = solve_ivp(lambda _, x: rates(x, share + du.reshape(4, 3), w), (0, h), STANDING + dx, rtol=1e-12,
                         atol=1e-14)  # fmt: skip
        return done.y[:, -1] - STANDING

    step = 1e-4
    for matrix, place, size in ((model.A, 0, 9), (model.B, 1, 12), (model.W, 2, 6)):
        for k in range(size):
            ends = []
            for sign in (1.0, -1.0):
                parts = [np.zeros(9), np.zeros(12), np.zeros(6)]
                parts[place][k] = sign * step
                ends.append(flow(*parts))
            np.testing.assert_allclose(matrix[:, k], (ends[0] - ends[1]) / (2 * step), atol=1e-8)


def test_standing_needs_the_weight_shared_evenly() -> None:
    plan = update(CentroidalLqr(MASS, 4), 0.0, STANDING)
    assert plan.status is MpcStatus.SOLVED
    np.testing.assert_allclose(plan.forces, np.tile(WEIGHT / 4, (20, 4, 1)), atol=1e-9)
    np.testing.assert_allclose(plan.xs, np.tile(STANDING, (21, 1)), atol=1e-12)


def test_near_rest_it_does_what_an_mpc_of_long_horizon_does() -> None:
    x = STANDING + 1e-3 * np.array([1.0, -2.0, 0.5, 3.0, 2.0, -1.0, 0.5, 0.2, -0.3])
    weights = CentroidalWeights(terminal=1.0)
    mpc = CentroidalMpc(MASS, 4, CentroidalMpcSettings(nodes=100, weights=weights))
    for _ in range(3):
        long = update(mpc, 0.0, x)
    lqr = update(CentroidalLqr(MASS, 4, LqrSettings(weights=TrackingWeights())), 0.0, x)
    asked = np.abs(long.first_forces - WEIGHT / 4).max()
    assert asked > 0.02
    np.testing.assert_allclose(lqr.first_forces, long.first_forces, atol=2e-3 * asked)


def test_closed_loop_on_the_nonlinear_model_comes_back_from_a_push() -> None:
    lqr, x = CentroidalLqr(MASS, 4), STANDING.copy()
    furthest = 0.0
    for i in range(200):
        wrench = np.r_[8.0 * (10 <= i < 30), 0.0, 0.0, 0.0, 0.0, 0.0]
        forces = update(lqr, 0.01 * i, x).first_forces
        x = solve_ivp(lambda _, y, f=forces, w=wrench: rates(y, f, w), (0, 0.01), x, rtol=1e-9).y[:, -1]
        furthest = max(furthest, abs(x[0]))
    assert furthest > 0.009
    np.testing.assert_allclose(x, STANDING, atol=1e-3)


def test_known_wrench_is_met_exactly() -> None:
    wrench = np.array([3.0, -2.0, 1.0, 0.05, 0.1, -0.02])
    plan = update(CentroidalLqr(MASS, 4), 0.0, STANDING, wrench=wrench)
    np.testing.assert_allclose(rates(STANDING, plan.first_forces, wrench), 0.0, atol=1e-9)
    np.testing.assert_allclose(plan.xs[-1], STANDING, atol=1e-9)


def test_forces_are_cut_to_cones_and_bounds() -> None:
    lqr = CentroidalLqr(MASS, 4)
    plan = update(lqr, 0.0, STANDING + [0.1, -0.1, 0.05, 2.0, 1.0, -2.0, 0.2, 0.0, 0.0], friction=0.3)
    sideways = np.linalg.norm(plan.forces[..., :2], axis=-1)
    assert (sideways <= 0.3 * plan.forces[..., 2] + 1e-9).all()
    assert (sideways >= 0.3 * plan.forces[..., 2] - 1e-9).any()
    assert (plan.forces[..., 2] >= 0.5).all() and (plan.forces[..., 2] <= 60.0).all()


def test_foot_in_the_air_has_no_force_and_the_others_stand() -> None:
    lqr = CentroidalLqr(MASS, 4)
    plan = update(lqr, 0.0, STANDING, flags=np.array([True, True, False, True]))
    assert (plan.forces[:, 2] == 0.0).all()
    assert np.abs(lqr.gain[6:9]).max() < 1e-12
    assert plan.first_forces[:, 2].sum() > 0.9 * WEIGHT[2]


@pytest.mark.parametrize("broken", ["com", "wrench", "time"])
def test_not_finite_input_keeps_the_last_plan(broken: str) -> None:
    lqr = CentroidalLqr(MASS, 4, LqrSettings(stale_after=2))
    good = update(lqr, 0.0, STANDING + [0.01, 0, 0, 0, 0, 0, 0, 0, 0])
    x, wrench = STANDING.copy(), np.zeros(6)
    if broken == "com":
        x[2] = math.nan
    if broken == "wrench":
        wrench[1] = math.inf
    t = math.nan if broken == "time" else 0.01
    plans = [update(lqr, t, x, wrench=wrench) for _ in range(4)]
    assert [plan.status for plan in plans] == [MpcStatus.NOT_FINITE] * 2 + [MpcStatus.STALE] * 2
    for plan in plans:
        np.testing.assert_array_equal(plan.forces, good.forces)
    assert lqr.failures == lqr.failures_in_a_row == 4
    assert update(lqr, 0.05, STANDING).status is MpcStatus.SOLVED and lqr.failures_in_a_row == 0


def test_before_any_success_and_without_any_contact_it_has_a_plan() -> None:
    lqr = CentroidalLqr(MASS, 4)
    plan = update(lqr, 0.3, np.full(9, np.nan))
    assert plan.status is MpcStatus.NOT_FINITE
    np.testing.assert_allclose(plan.first_forces, np.tile(WEIGHT / 4, (4, 1)))
    # Nothing can be regulated in the air: the Riccati equation has no stabilising solution.
    flying = update(lqr, 0.31, STANDING, flags=np.zeros(4, dtype=bool))
    assert flying.status is MpcStatus.SOLVER_FAILED
    assert np.isfinite(flying.xs).all()


def test_wrong_shapes_and_models_are_named() -> None:
    lqr = CentroidalLqr(MASS, 4)
    state = MeasuredState.centroidal(0.0, STANDING[:3], STANDING[3:])
    right = (ContactHorizon.allocate(20, 4), motion(STANDING), np.zeros((20, 6)))
    wrong = (ContactHorizon.allocate(20, 3), motion(STANDING, 19), np.zeros((19, 6)))
    for i in range(3):
        with pytest.raises(InputError, match="inputs of the MPC"):
            lqr.update(state, *(wrong[j] if i == j else right[j] for j in range(3)))
    with pytest.raises(InputError, match="mass: got -1"):
        CentroidalLqr(-1.0, 4)
    with pytest.raises(InputError, match="contacts: got 0"):
        CentroidalLqr(MASS, 0)
    for gravity in ((0.0, -9.81), (0.0, 0.0, np.nan)):
        with pytest.raises(InputError, match="gravity: got"):
            CentroidalLqr(MASS, 4, gravity=gravity)  # type: ignore[arg-type]


def test_the_gain_follows_the_contact_points_once_they_have_moved() -> None:
    """Within 5 mm the gain at hand serves; further away it is computed anew."""
    lqr = CentroidalLqr(MASS, 4)
    update(lqr, 0.0, STANDING)
    first = lqr.gain.copy()
    update(lqr, 0.01, STANDING, points=FEET + [0.004, 0.0, 0.0])
    np.testing.assert_array_equal(lqr.gain, first)
    update(lqr, 0.02, STANDING, points=FEET + [0.006, 0.0, 0.0])
    assert np.abs(lqr.gain - first).max() > 1e-6
    fresh = CentroidalLqr(MASS, 4)
    update(fresh, 0.0, STANDING, points=FEET + [0.006, 0.0, 0.0])
    np.testing.assert_array_equal(lqr.gain, fresh.gain)
