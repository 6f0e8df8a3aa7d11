from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from lgmpc.costs import (
    ConstraintItem,
    CostItem,
    Huber,
    MissingQuantityError,
    Parameter,
    ParameterLayout,
    Quadratic,
    QuadraticBarrier,
    Residual,
    StageSymbols,
    constraint_of,
    cost_of,
)
from lgmpc.errors import InputError
from lgmpc.robot.symbolic import SymbolicModel

MODEL = pin.buildSampleModelManipulator()
ARM = SymbolicModel(MODEL)
LAST = MODEL.frames[MODEL.nframes - 1].name


class Height(Residual):
    """The example of the module's documentation."""

    nr = 1
    parameters = (Parameter("height", 1, "above the ground, m", default=1.2),)

    def expression(self, s: StageSymbols) -> Any:
        return s.placement(LAST).translation[2] - s["height"]


class Speeds(Residual):
    nr = 2

    def expression(self, s: StageSymbols) -> Any:
        return s.v[:2] * s.u[0]


class Wrong(Residual):
    nr = 2

    def expression(self, s: StageSymbols) -> Any:
        return s.v[:3]


def symbols(layout: ParameterLayout, x: Any, p: Any, u: Any = None) -> StageSymbols:
    return StageSymbols(ARM, x, layout.split(p), u=u)


def test_a_users_own_residual_as_cost_and_as_constraint() -> None:
    cost = CostItem("hand", Height(), weight=10.0)
    bounds = ConstraintItem("ceiling", Height(), lower=-np.inf, upper=0.3)
    layout = ParameterLayout(*cost.parameters(), *bounds.parameters())
    assert list(layout) == ["hand_height", "hand_weight", "ceiling_height", "ceiling_lower", "ceiling_upper"]
    np.testing.assert_array_equal(layout.default, [1.2, 10.0, 1.2, -np.inf, 0.3])
    x, p = ca.SX.sym("x", 2 * MODEL.nv), ca.SX.sym("p", layout.size)
    s = symbols(layout, x, p)
    path = constraint_of([bounds], s)
    outputs = [cost_of([cost], s).value, path.value, path.lower, path.upper]
    function = ca.Function("f", [x, p], outputs)
    q = np.random.default_rng(0).uniform(-1.0, 1.0, MODEL.nq)
    data = MODEL.createData()
    pin.framesForwardKinematics(MODEL, data, q)
    z = data.oMf[MODEL.nframes - 1].translation[2]
    values = layout.default.copy()
    values[layout["hand_height"]] = 0.5  # changed between two solves without rebuilding
    got = [float(v) for v in function(np.r_[q, np.zeros(MODEL.nv)], values)]
    np.testing.assert_allclose(got, [5.0 * (z - 0.5) ** 2, z - 1.2, -np.inf, 0.3], rtol=1e-12)


def test_the_terminal_cost_depends_on_the_state_alone() -> None:
    items = [CostItem("hand", Height()), CostItem("speeds", Speeds())]
    layout = ParameterLayout(*(p for item in items for p in item.parameters()))
    x, p = ca.SX.sym("x", 2 * MODEL.nv), ca.SX.sym("p", layout.size)
    assert len(cost_of(items, symbols(layout, x, p), terminal=True).terms) == 1
    assert len(cost_of(items, symbols(layout, x, p, ca.SX.sym("u", 1))).terms) == 2
    with pytest.raises(MissingQuantityError, match="^u:"):
        cost_of(items, symbols(layout, x, p))


@pytest.mark.parametrize(
    ("activation", "value"),
    [
        (Quadratic(), lambda r: r**2 / 2),
        (
            QuadraticBarrier([-1.0, -np.inf], [np.inf, 1.5]),
            lambda r: np.r_[min(r[0] + 1, 0), max(r[1] - 1.5, 0)] ** 2 / 2,
        ),
        (Huber(0.8), lambda r: np.where(np.abs(r) < 0.8, r**2 / 2, 0.8 * (np.abs(r) - 0.4))),
    ],
    ids=lambda value: type(value).__name__,
)
def test_activation_and_its_derivatives(activation: Any, value: Any) -> None:
    layout = ParameterLayout(*activation.parameters("c", 2))
    r, p = ca.SX.sym("r", 2), ca.SX.sym("p", layout.size)
    bound = activation.bind("c", layout.split(p))
    function = ca.Function("a", [r, p], [bound.value(r), bound.gradient(r), bound.curvature(r)])

    def at(point: np.ndarray) -> list[np.ndarray]:
        return [v.full().ravel() for v in function(point, layout.default)]

    h = 1e-6
    for point in ([0.3, -0.4], [-2.0, 2.5], [1.7, -3.0], [0.0, 0.0], [1e6, -1e6]):
        here = np.array(point)
        got = at(here)
        np.testing.assert_allclose(got[0], value(here), rtol=1e-14, atol=1e-14)
        step = h * np.maximum(1.0, np.abs(here))
        plus, minus = at(here + step), at(here - step)
        np.testing.assert_allclose(got[1], (plus[0] - minus[0]) / (2 * step), rtol=1e-6, atol=1e-8)
        second = (plus[1] - minus[1]) / (2 * step)
        np.testing.assert_allclose(got[2], second, rtol=1e-6, atol=1e-8)
        assert (got[2] >= 0).all()


def test_huber_is_quadratic_up_to_its_threshold_and_linear_beyond() -> None:
    """At the threshold itself the quadratic holds, in the second derivative too."""
    r = ca.SX.sym("r", 5)
    huber = Huber(0.8)
    function = ca.Function("a", [r], [huber.value(r), huber.gradient(r), huber.curvature(r)])
    beyond = np.nextafter(0.8, 1.0)
    value, gradient, curvature = (v.full().ravel() for v in function([-beyond, -0.8, 0.5, 0.8, beyond]))
    np.testing.assert_allclose(value, [0.32, 0.32, 0.125, 0.32, 0.32], rtol=1e-14)
    np.testing.assert_allclose(gradient, [-0.8, -0.8, 0.5, 0.8, 0.8], rtol=1e-14)
    assert curvature.tolist() == [0.0, 1.0, 1.0, 1.0, 0.0]


def test_bad_input_is_named() -> None:
    with pytest.raises(InputError, match="name: got 'my hand'"):
        CostItem("my hand", Height())
    with pytest.raises(InputError, match=r"weight of 'hand': got shape \(2,\)"):
        CostItem("hand", Height(), weight=[1.0, 2.0])
    with pytest.raises(InputError, match=r"c_threshold: got shape \(3,\)"):
        CostItem("c", Speeds(), activation=Huber([1.0, 2.0, 3.0])).parameters()
    for activation, name in ((Huber([-0.1, 1.0]), "threshold"), (QuadraticBarrier(1.0, [2.0, -1.0]), "lower")):
        with pytest.raises(InputError, match=f"c_{name}: got"):
            CostItem("c", Speeds(), activation=activation)
    with pytest.raises(InputError, match="parameters: got two called 'a_weight'"):
        ParameterLayout(*CostItem("a", Speeds()).parameters(), *CostItem("a", Speeds()).parameters())
    item = CostItem("wrong", Wrong())
    layout = ParameterLayout(*item.parameters())
    s = symbols(layout, ca.SX.sym("x", 2 * MODEL.nv), ca.SX.sym("p", layout.size))
    with pytest.raises(InputError, match=r"Wrong.expression of 'wrong': got shape \(3, 1\)"):
        item.term(s)
    with pytest.raises(InputError, match="Did you mean weight"):
        s.within("wrong")["weigth"]
