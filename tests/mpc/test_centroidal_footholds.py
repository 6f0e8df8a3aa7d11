"""Footholds decided by the MPC: where they go, what bounds them, and that a second solver agrees."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lgmpc.errors import InputError
from lgmpc.locomotion.horizon import ContactHorizon, MotionReference
from lgmpc.mpc import (
    CentroidalFootholdMpc,
    CentroidalFootholdMpcSettings,
    CentroidalMpc,
    CentroidalMpcSettings,
    CentroidalWeights,
    MeasuredState,
    Plan,
)
from lgmpc.mpc.centroidal_footholds import FootholdDecisionSettings
from lgmpc.robot.friction import facet_normals
from lgmpc.solvers.qp import QP_SOLVERS

MASS, NODES, FACETS = 2.5, 20, 12
FEET = np.array([[0.2, 0.15, 0.0], [0.2, -0.15, 0.0], [-0.2, 0.15, 0.0], [-0.2, -0.15, 0.0]])
STANDING = np.array([0.0, 0.0, 0.21, 0, 0, 0, 0, 0, 0])
NORMALS = facet_normals(FACETS)


def trotting(first: int = 0, margins: float = 0.1) -> ContactHorizon:
    """Diagonal pairs in turn, six intervals each, ``first`` intervals on; feet land where they were."""
    contacts = ContactHorizon.allocate(NODES, 4, FACETS)
    contacts.hold(FEET, np.ones(4, dtype=bool), 0.6)
    phase = (np.arange(NODES) + first) // 6 % 2
    contacts.flags[:, [0, 3]] = (phase == 1)[:, None]
    contacts.flags[:, [1, 2]] = (phase == 0)[:, None]
    contacts.margins[~contacts.flags] = margins
    return contacts


def make(trust: float = 0.03, weight: float = 1e3, **change: object) -> CentroidalFootholdMpc:
    footholds = FootholdDecisionSettings(trust_region_m=trust, weight=weight)
    return CentroidalFootholdMpc(MASS, 4, CentroidalFootholdMpcSettings(footholds=footholds, **change))


def update(mpc: CentroidalMpc, t: float, x: np.ndarray, contacts: ContactHorizon) -> Plan:
    level = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (NODES + 1, 1))
    rest = np.zeros((NODES + 1, 3))
    reference = MotionReference(np.tile(STANDING[:3], (NODES + 1, 1)), rest, level, rest)
    return mpc.update(MeasuredState.centroidal(t, x[:3], x[3:]), contacts, reference, np.zeros((NODES, 6)))


def converged(mpc: CentroidalFootholdMpc, x: np.ndarray, contacts: ContactHorizon) -> Plan:
    for _ in range(12):
        plan = update(mpc, 0.0, x, contacts)
    return plan


PUSHED = STANDING + MASS * np.array([0, 0, 0, 0.4, -0.3, 0, 0, 0, 0])


def test_only_the_last_interval_of_a_swing_decides() -> None:
    contacts = trotting()
    contacts.margins[:6, 3] = 0.0
    contacts.margins[0, 0] = 0.02
    mpc = make()
    update(mpc, 0.0, PUSHED, contacts)
    units, margins = mpc.problem.view("foothold_unit"), mpc.problem.view("foothold_margin").reshape(-1, 4, FACETS)
    decided = [(5, 0), (11, 1), (11, 2), (17, 0), (17, 3)]
    assert list(zip(*np.nonzero(units), strict=True)) == decided
    unit = units[5, 0]
    assert unit == np.sqrt(1e-3 / 1e3)  # a shift costs as much as the force in the same place
    assert margins[5, 0].max() * unit == pytest.approx(0.03)  # the trust region, nearer than the margins
    assert all(np.ptp(margins[at]) == 0.0 for at in decided)


def test_the_trust_region_does_not_change_the_solution() -> None:
    (near, far), contacts = (make(trust=trust, weight=10.0) for trust in (0.005, 0.1)), trotting()
    for _ in range(12):
        plans = [update(each, 0.0, PUSHED, contacts) for each in (near, far)]
    shift = (plans[1].footholds - contacts.points)[0, 0]
    assert np.hypot(shift[0], shift[1]) > 0.02
    np.testing.assert_allclose(plans[0].footholds, plans[1].footholds, atol=1e-6)


def test_a_pushed_robot_steps_to_where_it_is_pushed() -> None:
    contacts = trotting()
    plan = converged(make(weight=100.0, weights=CentroidalWeights(angular_momentum=100.0)), PUSHED, contacts)
    assert plan.status.fresh and plan.footholds is not None
    shift = plan.footholds[0, 0] - FEET[0]
    assert shift[0] > 5e-3 and shift[1] < -5e-3 and shift[2] == 0.0
    np.testing.assert_array_equal(plan.footholds[:6, 0], np.tile(plan.footholds[6, 0], (6, 1)))
    np.testing.assert_array_equal(plan.footholds[0, 1], FEET[1])  # it stands
    assert (plan.forces[~contacts.flags] == 0.0).all()
    # Braking from there turns the robot less.
    same = CentroidalMpcSettings(weights=CentroidalWeights(angular_momentum=100.0))
    alone = update(CentroidalMpc(MASS, 4, same), 0.0, PUSHED, contacts)
    turning, turning_alone = (np.linalg.norm(each.xs[:, 6:8]) for each in (plan, alone))
    assert turning < 0.9 * turning_alone


def test_a_light_weight_lets_footholds_go_further() -> None:
    shifts = [converged(make(weight=w), PUSHED, trotting()).footholds[0, 0, 0] - FEET[0, 0] for w in (1e1, 1e2, 1e3)]
    assert shifts[0] > shifts[1] > shifts[2] > 5e-4


def test_without_margins_it_is_the_centroidal_mpc() -> None:
    contacts = trotting(margins=0.0)
    plan, alone = update(make(), 0.0, PUSHED, contacts), update(CentroidalMpc(MASS, 4), 0.0, PUSHED, contacts)
    np.testing.assert_allclose(plan.xs, alone.xs, atol=1e-9)
    np.testing.assert_allclose(plan.forces, alone.forces, atol=1e-6)
    np.testing.assert_array_equal(plan.footholds, contacts.points)


@pytest.mark.parametrize("qp_solver", QP_SOLVERS)
def test_every_solver_finds_the_same_footholds(qp_solver: str) -> None:
    contacts = trotting(first=3)
    chosen = make(qp_solver=qp_solver, weight=50.0)
    plan, own = converged(chosen, PUSHED, contacts), converged(make(weight=50.0), PUSHED, contacts)
    loose = 1e-3 if qp_solver == "osqp" else 1e-5
    np.testing.assert_allclose(plan.footholds, own.footholds, atol=loose)
    assert max(plan.kkt.stationarity, plan.kkt.constraint) < (0.1 if qp_solver == "osqp" else 1e-4)


@settings(max_examples=20, deadline=None)
@given(
    st.lists(st.floats(0.0, 0.15), min_size=FACETS, max_size=FACETS),
    st.floats(-2.0, 2.0),
    st.floats(-2.0, 2.0),
    st.integers(0, 11),
)
def test_no_plan_leaves_the_room_or_the_trust_region(
    mpc: CentroidalFootholdMpc, margins: list[float], vx: float, vy: float, first: int
) -> None:
    mpc.reset()
    last = np.zeros((NODES, 4, 2))
    x = STANDING + MASS * np.array([0, 0, 0, vx, vy, 0, 0, 0, 0])
    contacts = trotting(first)
    contacts.margins[~contacts.flags] = margins
    for _ in range(4):
        plan = update(mpc, 0.0, x, contacts)
        assert plan.status.fresh and plan.footholds is not None
        shift = (plan.footholds - contacts.points)[:, :, :2]
        assert (shift @ NORMALS.T <= np.maximum(margins, 1e-4) + 1e-6).all()
        assert ((shift - last) @ NORMALS.T <= 0.02 + 1e-6).all()
        last = shift


@pytest.fixture(scope="module")
def mpc() -> CentroidalFootholdMpc:
    return make(trust=0.02, weight=10.0)


def test_a_foothold_stays_where_it_is_while_time_goes_on() -> None:
    """Half an interval later the same swing ends at another node: the foothold does not jump."""
    mpc = make()
    x = PUSHED.copy()
    first = converged(mpc, x, trotting(first=1))
    later = update(mpc, 0.01, x, trotting(first=1))
    assert np.abs(first.footholds[0, 0] - later.footholds[0, 0]).max() < 5e-3


def test_the_same_inputs_give_the_same_bits() -> None:
    plans = [converged(make(), PUSHED, trotting()) for _ in range(2)]
    np.testing.assert_array_equal(plans[0].footholds, plans[1].footholds)
    np.testing.assert_array_equal(plans[0].xs, plans[1].xs)


def test_a_failed_update_keeps_the_last_footholds_and_says_so() -> None:
    mpc = make()
    good = update(mpc, 0.0, PUSHED, trotting())
    bad = update(mpc, 0.01, PUSHED * np.nan, trotting())
    assert not bad.status.fresh
    np.testing.assert_array_equal(bad.footholds, good.footholds)


def test_rooms_of_the_wrong_shape_are_named() -> None:
    contacts = ContactHorizon.allocate(NODES, 4)
    with pytest.raises(InputError, match=r"contacts\.margins: got shape \(20, 4, 0\); expected shape \(20, 4, 12\)"):
        update(make(), 0.0, STANDING, contacts)
