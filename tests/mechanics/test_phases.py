from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import quad, solve_ivp

from lgmpc.errors import InputError
from lgmpc.lie import so3
from lgmpc.lie.symbolic import so3 as symbolic
from lgmpc.mechanics.connection import Connection, circle
from lgmpc.mechanics.phases import Cat, ThreeLink, flip

CAT = Cat()
SNAKE = ThreeLink([1.0, 1.5, 0.8], [0.5, 0.6, 0.4])


def lopsided(r: Any, xi: Any, speed: Any) -> Any:
    """A body with two weights on crossed, tilted rails: its angular velocity takes all directions."""
    total = 0.5 * xi.T @ ca.DM([[1.0, 0.1, 0.0], [0.1, 1.3, 0.2], [0.0, 0.2, 0.8]]) @ xi
    for mass, base, rail in ((0.7, [0.3, 0.9, -0.2], [0.8, 0.0, 0.6]), (1.1, [0.1, -0.5, 0.7], [0.0, 1.0, 0.3])):
        index = 0 if mass == 0.7 else 1
        point = ca.DM(base) + ca.DM(rail) * ca.sin(r[index])
        velocity = ca.cross(xi, point) + ca.DM(rail) * ca.cos(r[index]) * speed[index]
        total += 0.5 * mass * ca.sumsqr(velocity)
    return total


def test_transport_has_order_six_and_the_right_limit_on_a_non_abelian_bundle() -> None:
    # Part of a circle: once around, the quadrature of something periodic would converge faster than any power.
    connection, whole = Connection(lopsided, 2, 3), circle([0.2, 0.5], 1.1)
    loop = lambda s: whole(0.7 * s)  # noqa: E731
    s = ca.SX.sym("s")
    velocity = ca.Function("v", [s], [-connection.form(loop(s)) @ ca.jacobian(loop(s), s)])

    def rate(time: float, entries: np.ndarray) -> np.ndarray:
        return (entries.reshape(3, 3) @ so3.hat(velocity(time).full().ravel())).ravel()

    ends = solve_ivp(rate, (0.0, 1.0), np.eye(3).ravel(), method="DOP853", rtol=1e-13, atol=1e-14)
    truth = ends.y[:, -1].reshape(3, 3)
    assert np.linalg.norm(so3.log(truth)) > 0.1
    errors = [np.abs(connection.transport(loop, n)[-1] - truth).max() for n in (16, 32)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(6.0, abs=0.3)
    np.testing.assert_allclose(connection.transport(loop, 300)[-1], truth, rtol=0, atol=1e-11)


def test_small_loops_turn_by_the_curvature_times_their_area() -> None:
    connection, center = Connection(lopsided, 2, 3), [0.2, 0.5]
    predicted = -connection.curvature(center).full()[:, 1] * np.pi
    # Seen from the loop's centre, not from its first point: the body is carried out along the first ray, and back.
    out = lambda radius: connection.transport(lambda s: ca.DM(center) + ca.vertcat(radius * s, 0), 20)[-1]  # noqa: E731
    errors = []
    for radius in (0.04, 0.02):
        ray = out(radius)
        turn = so3.log(ray @ connection.holonomy(circle(center, radius)) @ ray.T)
        errors.append(np.abs(turn / radius**2 - predicted).max())
    assert errors[1] < 1e-3 * np.abs(predicted).max()
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.2)


def test_another_body_frame_changes_connection_and_holonomy_as_a_gauge() -> None:
    def frame(r: Any) -> Any:
        return ca.vertcat(0.4 * r[0], 0.3 * r[1] ** 2, 0.2 * ca.sin(r[0] + r[1]))

    def moved(r: Any, xi: Any, speed: Any) -> Any:
        # g = h exp(frame): the velocity of h, which the energy depends on, from that of g.
        own = symbolic.right_jacobian(frame(r)) @ (ca.jacobian(frame(r), r) @ speed)
        return lopsided(r, symbolic.exp(frame(r)) @ (xi - own), speed)

    one, other = Connection(lopsided, 2, 3), Connection(moved, 2, 3)
    loop = circle([0.2, 0.5], 0.8)
    turn = so3.exp(ca.DM(frame(ca.DM(loop(ca.DM(0.0))))).full().ravel())
    expected = turn.T @ one.holonomy(loop) @ turn
    np.testing.assert_allclose(other.holonomy(loop), expected, rtol=0, atol=1e-11)
    point, between = [0.9, -0.3], so3.exp(ca.DM(frame(ca.DM([0.9, -0.3]))).full().ravel())
    curvatures = [connection.curvature(point).full()[:, 1] for connection in (one, other)]
    np.testing.assert_allclose(curvatures[1], between.T @ curvatures[0], rtol=0, atol=1e-12)


@pytest.mark.parametrize("bend", [0.3, 1.0, 2.0])
def test_a_circuit_of_the_bend_turns_the_cat_as_in_closed_form(bend: float) -> None:
    turn = CAT.connection().holonomy(flip(bend), 300)
    np.testing.assert_allclose(turn, so3.exp([0.0, 0.0, CAT.turn(bend)]), rtol=0, atol=1e-12)


@pytest.mark.parametrize("ratio", [0.6, 1.0, 2.5, 20.0])
def test_the_cat_lands_on_its_feet(ratio: float) -> None:
    cat = Cat(axial=0.01, transverse=0.01 * ratio)
    turn = cat.connection().holonomy(flip(cat.flipping_bend()), 300)
    np.testing.assert_allclose(turn, np.diag([-1.0, -1.0, 1.0]), rtol=0, atol=1e-12)


def momentum(model: pin.Model, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.array(pin.computeCentroidalMomentum(model, model.createData(), q, v).vector)


def test_pinocchio_finds_no_angular_momentum_in_the_cat() -> None:
    """The same two halves as a tree: the rear one free, the front one on a spherical joint."""
    model = pin.Model()
    inertia = np.diag([CAT.transverse, CAT.transverse, CAT.axial])
    root = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "rear")
    model.appendBodyToJoint(root, pin.Inertia(CAT.mass, np.array([0, 0, -CAT.length]), inertia), pin.SE3.Identity())
    neck = model.addJoint(root, pin.JointModelSpherical(), pin.SE3.Identity(), "front")
    model.appendBodyToJoint(neck, pin.Inertia(CAT.mass, np.array([0, 0, CAT.length]), inertia), pin.SE3.Identity())
    form, rng = CAT.connection().form, np.random.default_rng(0)
    for _ in range(5):
        r, speed = rng.normal(size=2), rng.normal(size=2)
        xi = -form(r).full() @ speed
        bend, rate = np.r_[r, 0.0] / 2, np.r_[speed, 0.0] / 2
        front, rear = so3.exp(bend), so3.exp(-bend)
        turning = [
            turn.T @ (xi + so3.left_jacobian(b) @ w) for turn, b, w in ((front, bend, rate), (rear, -bend, -rate))
        ]
        relative = rear.T @ front
        q = np.r_[pin.SE3ToXYZQUAT(pin.SE3(rear, np.zeros(3))), pin.Quaternion(relative).coeffs()]
        v = np.r_[np.zeros(3), turning[1], turning[0] - relative.T @ turning[1]]
        assert np.abs(momentum(model, q, v)[3:]).max() < 1e-15
        # What the test would see: without the connection's turn there is momentum.
        still = np.r_[np.zeros(3), turning[1] - rear.T @ xi, v[6:]]
        assert np.abs(xi).max() < 1e-6 or np.abs(momentum(model, q, still)[3:]).max() > 1e-6


def test_pinocchio_finds_no_angular_momentum_in_the_snake() -> None:
    model = pin.Model()
    root = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "middle")
    half = SNAKE.lengths / 2

    def body(index: int, lever: float) -> pin.Inertia:
        return pin.Inertia(SNAKE.masses[index], np.array([lever, 0, 0]), np.diag([0.1, 0.1, SNAKE.inertias[index]]))

    model.appendBodyToJoint(root, body(1, 0.0), pin.SE3.Identity())
    ends = ((0, -half[1], -half[0]), (2, half[1], half[2]))
    for index, at, lever in ends:
        joint = model.addJoint(root, pin.JointModelRZ(), pin.SE3(np.eye(3), np.array([at, 0, 0])), f"joint{index}")
        model.appendBodyToJoint(joint, body(index, lever), pin.SE3.Identity())
    connection, rng = SNAKE.connection(), np.random.default_rng(0)
    for _ in range(5):
        r, speed = rng.normal(size=2), rng.normal(size=2)
        xi = (-connection.form(r).full() @ speed)[0]
        q = np.r_[0, 0, 0, 0, 0, 0, 1, r]
        found = momentum(model, q, np.r_[np.zeros(5), xi, speed])
        assert abs(found[5]) < 1e-14 and abs(momentum(model, q, np.r_[np.zeros(6), speed])[5]) > 1e-3
        locked = pin.ccrba(model, model.createData(), q, np.zeros(8))
        assert connection.locked_inertia(r).full()[0, 0] == pytest.approx(locked[5, 5], abs=1e-13)


@pytest.mark.parametrize("radius", [0.01, 0.3, 1.0, 2.5])
def test_the_snakes_phase_is_the_area_integral_of_its_curvature(radius: float) -> None:
    loop, center, connection = circle([0.3, -0.4], radius), [0.3, -0.4], SNAKE.connection()
    by_area = connection.phase_by_area(loop, center)
    assert float(connection.holonomy(loop)) == pytest.approx(by_area, rel=1e-10, abs=1e-14)

    def slope(s: float) -> float:  # scipy's own quadrature along the loop
        shape = np.array(center) + radius * np.array([np.cos(2 * np.pi * s), np.sin(2 * np.pi * s)])
        velocity = 2 * np.pi * radius * np.array([-np.sin(2 * np.pi * s), np.cos(2 * np.pi * s)])
        return float((-connection.form(shape).full() @ velocity)[0])

    assert by_area == pytest.approx(quad(slope, 0.0, 1.0, epsabs=1e-13, epsrel=1e-13)[0], abs=1e-11)


def test_the_snakes_phase_scales_with_the_area_of_small_loops_and_turns_its_sign_with_their_sense() -> None:
    connection = SNAKE.connection()
    density = -connection.curvature([0.3, -0.4]).full()[0, 1]
    deviations = []
    for radius in (0.2, 0.1):
        phase = float(connection.holonomy(circle([0.3, -0.4], radius)))
        deviations.append(abs(phase / (np.pi * radius**2) - density))
    assert np.log2(deviations[0] / deviations[1]) == pytest.approx(2.0, abs=0.1)
    loop = circle([0.3, -0.4], 1.0)
    backwards = float(connection.holonomy(lambda s: loop(1 - s)))
    assert backwards == pytest.approx(-float(connection.holonomy(loop)), abs=1e-13)


def test_the_links_hang_together_about_their_centre_of_mass() -> None:
    r, theta = np.array([[0.4, -0.7], [1.0, 2.0]]), np.array([0.3, -1.0])
    centers, angles = SNAKE.links(r, theta)
    np.testing.assert_allclose(np.einsum("l,nlk->nk", SNAKE.masses, centers), 0.0, atol=1e-15)
    along = SNAKE.lengths[None, :, None] / 2 * np.stack((np.cos(angles), np.sin(angles)), axis=-1)
    np.testing.assert_allclose(centers[:, 0] + along[:, 0], centers[:, 1] - along[:, 1], atol=1e-15)
    np.testing.assert_allclose(centers[:, 1] + along[:, 1], centers[:, 2] - along[:, 2], atol=1e-15)


@pytest.mark.parametrize(
    ("call", "argument"),
    [
        (lambda: Cat(mass=-1.0), "mass"),
        (lambda: Cat(axial=0.1, transverse=0.01), "axial"),
        (lambda: ThreeLink([1.0, 1.0], [1.0, 1.0, 1.0]), "masses"),
        (lambda: ThreeLink([1.0, 1.0, 1.0], [1.0, 0.0, 1.0]), "lengths"),
        (lambda: Connection(CAT.energy, 2, 2), "dimension"),
        (lambda: circle([0.0, 0.0], 0.0), "radius"),
        (lambda: CAT.connection().holonomy(lambda s: ca.vertcat(s, 0)), "loop"),
        (lambda: CAT.connection().transport(lambda s: ca.vertcat(s, s, s), 10), "loop"),
        (lambda: CAT.connection().transport(flip(1.0), 0), "steps"),
        (lambda: CAT.connection().phase_by_area(flip(1.0), [0.0, 0.0]), "connection"),
    ],
)
def test_bad_input_is_named(call: Callable[[], object], argument: str) -> None:
    with pytest.raises(InputError) as caught:
        call()
    assert caught.value.argument == argument
