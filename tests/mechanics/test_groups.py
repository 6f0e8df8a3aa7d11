from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import expm

from lgmpc.errors import InputError
from lgmpc.lie import checks, sek3
from lgmpc.lie.symbolic import sek3 as symbolic_sek3
from lgmpc.mechanics import SE3, SEMIDIRECT, SO3, LieGroup

SE23 = LieGroup("se23", 9, 5, sek3, symbolic_sek3, checks.extended_pose)
GROUPS = (SO3, SE3, SEMIDIRECT, SE23)


@pytest.mark.parametrize("group", GROUPS, ids=lambda group: group.name)
def test_bracket_adjoint_and_exponential_are_those_of_the_matrices(group: LieGroup) -> None:
    rng = np.random.default_rng(1)
    x, y = rng.normal(size=(2, group.dim))
    hat, vee, g = group.numeric.hat, group.numeric.vee, group.numeric.exp(x)
    assert g.shape == (group.size, group.size)
    np.testing.assert_allclose(g, expm(hat(x)), atol=1e-13)
    np.testing.assert_allclose(group.numeric.ad(x) @ y, vee(hat(x) @ hat(y) - hat(y) @ hat(x)), atol=1e-13)
    np.testing.assert_allclose(group.numeric.adjoint(g) @ y, vee(g @ hat(y) @ np.linalg.inv(g)), atol=1e-13)
    np.testing.assert_array_equal(group.numeric.coadjoint(x), group.numeric.ad(x).T)
    np.testing.assert_allclose(group.check_element("g", g), g)


@pytest.mark.parametrize("group", GROUPS, ids=lambda group: group.name)
def test_expressions_and_numbers_are_the_same_group(group: LieGroup) -> None:
    rng = np.random.default_rng(2)
    x, y = rng.normal(size=(2, group.dim))
    g, h = group.numeric.exp(x), group.numeric.exp(y)
    for name, arguments in (
        ("exp", (x,)),
        ("log", (g,)),
        ("compose", (g, h)),
        ("inverse", (g,)),
        ("adjoint", (g,)),
        ("ad", (x,)),
        ("coadjoint", (x,)),
        ("left_jacobian_inverse", (x,)),
        ("right_jacobian_inverse", (x,)),
    ):
        expression = getattr(group.symbolic, name)(*(ca.DM(a) for a in arguments))
        number = getattr(group.numeric, name)(*arguments)
        np.testing.assert_allclose(ca.DM(expression).full().reshape(number.shape), number, atol=1e-13, err_msg=name)


@pytest.mark.parametrize(
    ("group", "value", "message"),
    [
        (SO3, np.diag([1.0, 1.0, 2.0]), "pose: .* expected a rotation"),
        (SO3, np.diag([1.0, 1.0, -1.0]), "pose: got a reflection"),
        (SE3, np.eye(3), "pose: got shape"),
        (SE3, np.tile(np.eye(4), (2, 1, 1)), "pose: got shape"),
        (SE3, np.full((4, 4), np.nan), "pose: .* finite"),
        (SE23, np.eye(4), r"pose: got shape \(4, 4\)"),
    ],
)
def test_what_is_no_element_is_refused(group: LieGroup, value: np.ndarray, message: str) -> None:
    with pytest.raises(InputError, match=message):
        group.check_element("pose", value)


def test_dimensions_that_do_not_exist_are_refused() -> None:
    with pytest.raises(InputError, match=r"velocity: got shape \(2,\)"):
        SO3.check_tangent("velocity", [1.0, 2.0])


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("group", GROUPS, ids=lambda group: group.name)
def test_velocities_vary_with_a_bracket(group: LieGroup, side: str) -> None:
    """What Euler and Poincare's equations rest on: ``delta xi = eta' + [xi, eta]`` for ``xi = g^-1 g'`` (chapter 4.3.2;
    Marsden and Ratiu 1999, 13.5.2), and ``zeta' - [xi, zeta]`` for ``xi = g' g^-1`` (appendix on the spatial form)."""
    rng, t, e = np.random.default_rng(4), ca.SX.sym("t"), ca.SX.sym("e")
    a, b, c, d = rng.normal(size=(4, group.dim))
    symbolic, n = group.symbolic, group.size
    motion, nudge = symbolic.exp(ca.DM(a) * t + ca.DM(b) * t**2), symbolic.exp(e * (ca.DM(c) + ca.DM(d) * t))
    pose = symbolic.compose(motion, nudge) if side == "left" else symbolic.compose(nudge, motion)
    rate = ca.reshape(ca.jacobian(ca.vec(pose), t), n, n)
    velocity = symbolic.inverse(pose) @ rate if side == "left" else rate @ symbolic.inverse(pose)
    varied = ca.reshape(ca.jacobian(ca.vec(velocity), e), n, n)
    xi_hat, delta = (m.full() for m in ca.Function("variation", [t, e], [velocity, varied])(0.7, 0.0))
    xi, eta = group.numeric.vee(xi_hat), c + 0.7 * d
    sign = 1.0 if side == "left" else -1.0
    expected = d + sign * group.numeric.ad(xi) @ eta
    np.testing.assert_allclose(delta, group.numeric.hat(expected), rtol=0, atol=1e-12)
