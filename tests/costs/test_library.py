from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from samples import solo
from scipy.optimize import linprog

from lgmpc.costs import MissingQuantityError, ParameterLayout, Residual, StageSymbols
from lgmpc.costs.library import (
    CenterOfPressure,
    CentroidalMomentum,
    CoMPosition,
    ContactControlGravity,
    ContactForce,
    Control,
    FramePlacement,
    FrameRotation,
    FrameRotationMatrix,
    FrameTranslation,
    FrameVelocity,
    FrictionCone,
    JointAcceleration,
    JointPosition,
    StateError,
    WrenchCone,
)
from lgmpc.errors import InputError
from lgmpc.state import StateMultibody

FEET = ("FL_FOOT", "FR_FOOT")


@dataclass(frozen=True)
class Point:
    """A random node of Solo12: a point contact at the first foot, a surface contact at the second."""

    x: np.ndarray
    u: np.ndarray
    a: np.ndarray
    tau: np.ndarray
    force: np.ndarray
    wrench: np.ndarray

    @property
    def q(self) -> np.ndarray:
        return self.x[: solo().nq]

    @property
    def v(self) -> np.ndarray:
        return self.x[solo().nq :]

    def data(self) -> pin.Data:
        model = solo().model
        data = model.createData()
        pin.forwardKinematics(model, data, self.q, self.v, self.a)
        pin.updateFramePlacements(model, data)
        return data


def random_point(rng: np.random.Generator) -> Point:
    state, robot = StateMultibody(solo().model), solo()
    x = state.integrate(state.neutral(), rng.uniform(-1.0, 1.0, state.ndx))
    normal = rng.standard_normal
    return Point(x, normal(12), normal(robot.nv), normal(12), normal(3), normal(6))


@dataclass(frozen=True)
class Compiled:
    """A residual as numeric functions of a point: value, and derivatives in tangent coordinates."""

    layout: ParameterLayout
    value: Callable[..., np.ndarray]
    jacobian: ca.Function

    def arguments(self, point: Point, p: np.ndarray | None = None) -> list[np.ndarray]:
        values = self.layout.default if p is None else p
        return [point.x, point.u, point.a, point.tau, point.force, point.wrench, values]


def build(residual: Residual) -> Compiled:
    robot, state = solo(), StateMultibody(solo().model)
    layout = ParameterLayout(*residual.parameters)
    sizes = {"x": state.nx, "u": 12, "a": robot.nv, "tau": 12, "force": 3, "wrench": 6, "p": layout.size}
    m = {name: ca.SX.sym(name, size) for name, size in sizes.items()}

    def expression(x: ca.SX) -> ca.SX:
        forces = {FEET[0]: m["force"], FEET[1]: m["wrench"]}
        s = StageSymbols(robot.symbolic, x, layout.split(m["p"]), u=m["u"], a=m["a"], tau=m["tau"], forces=forces)
        return residual.expression(s)

    inputs = list(m.values())
    value = ca.Function("value", inputs, [expression(m["x"])])
    dx = ca.SX.sym("dx", state.ndx)
    moved = value(state.integrate_symbolic(m["x"], dx), *inputs[1:])
    slopes = [ca.jacobian(moved, variable) for variable in (dx, *inputs[1:6])]
    jacobian = ca.Function("jacobian", inputs, ca.substitute(slopes, [dx], [ca.SX.zeros(state.ndx)]))
    return Compiled(layout, lambda *args: value(*args).full().ravel(), jacobian)


POINT, SURFACE = FEET
RNG = np.random.default_rng(11)
STATE = StateMultibody(solo().model)
X_REFERENCE = random_point(RNG).x
TARGET = pin.SE3(pin.Quaternion(*(np.array([0.3, -0.5, 0.1, 0.8]) / math.sqrt(0.99))).matrix(), np.array([0.1, 2, 3]))
TARGET7 = pin.SE3ToXYZQUAT(TARGET)
REF3, REF6, REF12 = RNG.standard_normal(3), RNG.standard_normal(6), RNG.standard_normal(12)
TILTED = pin.exp3(np.array([0.2, -0.4, 0.3]))[:, 2]


def placement(point: Point, frame: str) -> pin.SE3:
    return point.data().oMf[solo().frame(frame)]


def gravity(point: Point) -> np.ndarray:
    return pin.computeGeneralizedGravity(solo().model, solo().create_data(), point.q)


def contact_gravity(point: Point) -> np.ndarray:
    model, data, total = solo().model, solo().create_data(), gravity(point)
    for frame, wrench in ((POINT, np.r_[point.force, 0, 0, 0]), (SURFACE, point.wrench)):
        jacobian = pin.computeFrameJacobian(model, data, point.q, solo().frame(frame), pin.LOCAL_WORLD_ALIGNED)
        total = total - jacobian.T @ wrench
    return total


def momentum(point: Point) -> np.ndarray:
    return np.array(pin.computeCentroidalMomentum(solo().model, solo().create_data(), point.q, point.v).vector)


def velocity(point: Point) -> np.ndarray:
    return np.array(pin.getFrameVelocity(solo().model, point.data(), solo().frame(SURFACE), pin.LOCAL).vector)


def pyramid(point: Point) -> np.ndarray:
    along = np.array([1.0, 0.0, 0.0]) - TILTED[0] * TILTED  # above the world's x axis
    along /= np.linalg.norm(along)
    f = np.array([along, np.cross(TILTED, along), TILTED]) @ point.force
    angles = np.arange(6) * math.pi / 3
    facets = 0.6 * math.cos(math.pi / 6) * f[2] - np.cos(angles) * f[0] - np.sin(angles) * f[1]
    return np.append(facets, f[2])


def wrench_cone(s: Point) -> np.ndarray:
    back = placement(s, SURFACE).rotation.T
    (fx, fy, fz), (mx, my, mz) = back @ s.wrench[:3], back @ s.wrench[3:]
    a, b, m = 0.1, 0.05, 0.6 * math.cos(math.pi / 4)
    signs = list(itertools.product((1, -1), repeat=3))
    torsion = [m * (a + b) * fz - k * mz - i * (b * fx + k * m * mx) - j * (a * fy + k * m * my) for k, i, j in signs]
    sliding = [m * fz - fx, m * fz + fx, m * fz - fy, m * fz + fy]
    return np.array([fz, *sliding, a * fz - my, a * fz + my, b * fz - mx, b * fz + mx, *torsion])


def pressure(point: Point) -> np.ndarray:
    force = pin.Force(point.wrench)
    local = pin.SE3(placement(point, SURFACE).rotation, np.zeros(3)).actInv(force)
    (mx, my, _), fz = local.angular, local.linear[2]
    return np.array([0.1 * fz - my, 0.1 * fz + my, 0.05 * fz - mx, 0.05 * fz + mx])


def psi(point: Point) -> float:
    return 0.5 * float(np.trace(np.eye(3) - TARGET.rotation.T @ placement(point, POINT).rotation))


# name -> (residual, the same from Pinocchio's numeric functions)
LIBRARY: dict[str, tuple[Residual, Callable[[Point], np.ndarray]]] = {
    "state": (
        StateError(STATE, X_REFERENCE),
        lambda s: np.r_[pin.difference(solo().model, X_REFERENCE[:19], s.q), s.v - X_REFERENCE[19:]],
    ),
    "control": (Control(12, REF12), lambda s: s.u - REF12),
    "acceleration": (JointAcceleration(12, REF12), lambda s: s.a[6:] - REF12),
    "contact gravity": (ContactControlGravity(12), lambda s: s.tau - contact_gravity(s)[6:]),
    "com": (CoMPosition(REF3), lambda s: pin.centerOfMass(solo().model, solo().create_data(), s.q) - REF3),
    "joint position": (JointPosition(12, REF12), lambda s: s.q[7:] - REF12),
    "momentum": (CentroidalMomentum(REF6), lambda s: momentum(s) - REF6),
    "placement": (FramePlacement(POINT, TARGET7), lambda s: pin.log6(TARGET.actInv(placement(s, POINT))).vector),
    "rotation": (
        FrameRotation(POINT, TARGET7[3:]),
        lambda s: pin.log3(TARGET.rotation.T @ placement(s, POINT).rotation),
    ),
    "rotation matrix": (
        FrameRotationMatrix(POINT, TARGET7[3:]),
        lambda s: (placement(s, POINT).rotation - TARGET.rotation).ravel(order="F") / math.sqrt(2),
    ),
    "translation": (FrameTranslation(SURFACE, REF3), lambda s: placement(s, SURFACE).translation - REF3),
    "velocity": (FrameVelocity(SURFACE, pin.LOCAL, REF6), lambda s: velocity(s) - REF6),
    "force": (ContactForce(POINT, 3, REF3), lambda s: s.force - REF3),
    "wrench": (ContactForce(SURFACE, 6, REF6), lambda s: s.wrench - REF6),
    "cone": (FrictionCone(POINT, 6, 0.6, TILTED), pyramid),
    "pressure": (CenterOfPressure(SURFACE, (0.1, 0.05)), pressure),
    "wrench cone": (WrenchCone(SURFACE, (0.1, 0.05), 0.6), wrench_cone),
}


def near_half_turn(rng: np.random.Generator) -> Point:
    """A point whose first foot stands half a turn, less a little, from the target."""
    point = random_point(rng)
    axis = rng.standard_normal(3)
    goal = TARGET.rotation @ pin.exp3((math.pi - 1e-3) * axis / np.linalg.norm(axis))
    turn = goal @ placement(point, POINT).rotation.T
    x = point.x.copy()
    x[3:7] = pin.Quaternion(turn @ pin.Quaternion(x[3:7]).matrix()).coeffs()
    return Point(x, point.u, point.a, point.tau, point.force, point.wrench)


def at_zero_force(rng: np.random.Generator) -> Point:
    point = random_point(rng)
    return Point(point.x, point.u, point.a, point.tau, np.zeros(3), np.zeros(6))


@pytest.mark.parametrize("name", LIBRARY)
def test_residual_and_its_derivatives(name: str) -> None:
    residual, oracle = LIBRARY[name]
    compiled = build(residual)
    rng = np.random.default_rng(1)
    for make in (random_point, random_point, near_half_turn, at_zero_force):
        point = make(rng)
        arguments = compiled.arguments(point)
        value = compiled.value(*arguments)
        assert value.shape == (residual.nr,)
        near_pi = make is near_half_turn and name in ("rotation", "placement")
        np.testing.assert_allclose(value, oracle(point), rtol=0, atol=1e-9 if near_pi else 1e-11)
        h = 1e-5
        for i, slope in enumerate(compiled.jacobian(*arguments)):
            size = STATE.ndx if i == 0 else arguments[i].size
            difference = np.empty((residual.nr, size))
            for k in range(size):
                ends = []
                for sign in (h, -h):
                    step = np.zeros(size)
                    step[k] = sign
                    moved = list(arguments)
                    moved[i] = STATE.integrate(point.x, step) if i == 0 else arguments[i] + step
                    ends.append(compiled.value(*moved))
                difference[:, k] = (ends[0] - ends[1]) / (2 * h)
            scale = max(1.0, float(np.abs(difference).max(initial=0.0)))
            np.testing.assert_allclose(slope.full(), difference, rtol=0, atol=1e-6 * scale)


def test_the_wrench_cone_is_what_forces_at_the_corners_sum_to() -> None:
    """Two sets, one by the closed form, one by linear programming, are the same on random rays and at their ends."""
    a, b, friction = 0.1, 0.05, 0.6
    compiled, rng = build(WrenchCone(SURFACE, (a, b), friction)), np.random.default_rng(7)
    point = random_point(rng)
    rotation = placement(point, SURFACE).rotation
    m = friction / math.sqrt(2.0)
    edges = np.array([[x, y, 1.0] for x in (m, -m) for y in (m, -m)])
    corners = [np.array([x, y, 0.0]) for x in (a, -a) for y in (b, -b)]
    generators = np.array([[*edge, *np.cross(corner, edge)] for corner in corners for edge in edges]).T
    # From the middle of the cone towards random directions, as far as corners can give the wrench.
    middle = generators.sum(axis=1)
    for _ in range(50):
        ray = rng.standard_normal(6) * [1.0, 1.0, 1.0, b, a, a]
        farthest = linprog(
            [*np.zeros(16), -1.0], A_eq=np.column_stack([generators, -ray]), b_eq=middle, bounds=(0.0, None)
        )
        length = farthest.x[-1] if farthest.status == 0 else math.inf
        for factor, inside in ((1.0 - 1e-6, True), (1.0 + 1e-6, False)):
            if math.isinf(length):
                factor, inside = 1e3, True
            wrench = middle + (factor if math.isinf(length) else factor * length) * ray
            world = np.concatenate([rotation @ wrench[:3], rotation @ wrench[3:]])
            there = Point(point.x, point.u, point.a, point.tau, point.force, world)
            margin = compiled.value(*compiled.arguments(there)).min()
            assert (margin > 0.0) == inside, (factor, margin)


def test_half_the_square_of_the_matrix_residual_is_psi() -> None:
    point = random_point(np.random.default_rng(2))
    compiled = build(LIBRARY["rotation matrix"][0])
    value = compiled.value(*compiled.arguments(point))
    assert 0.5 * value @ value == pytest.approx(psi(point), rel=1e-12)


def test_references_are_parameters() -> None:
    compiled = build(CoMPosition())
    point = random_point(np.random.default_rng(4))
    p = np.array([1.0, 2.0, 3.0])
    moved = compiled.value(*compiled.arguments(point)) - compiled.value(*compiled.arguments(point, p))
    np.testing.assert_allclose(moved, p, rtol=0, atol=1e-14)


def test_bad_input_is_named() -> None:
    with pytest.raises(InputError, match="facets: got 2"):
        FrictionCone(POINT, 2)
    with pytest.raises(InputError, match="normal: got .* expected a unit vector"):
        FrictionCone(POINT, normal=(0.0, 0.0, 2.0))
    for surface in (CenterOfPressure(POINT, (0.1, 0.1)), WrenchCone(POINT, (0.1, 0.1))):
        with pytest.raises(InputError, match="a point contact"):
            build(surface)
    with pytest.raises(InputError, match="Did you mean FL_FOOT"):
        build(ContactForce("FL_FOT"))
    with pytest.raises(InputError, match="default of reference: got shape"):
        ParameterLayout(*CoMPosition([1.0, 2.0]).parameters)


def test_a_quantity_that_a_node_lacks_is_named() -> None:
    s = StageSymbols(solo().symbolic, STATE.neutral(), {})
    for name in ("u", "a", "tau", "forces"):
        with pytest.raises(MissingQuantityError, match=f"^{name}: got a node without it"):
            getattr(s, name)
