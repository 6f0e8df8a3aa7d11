r"""Euler-Poincare equations on any matrix group, from a reduced Lagrangian written as an expression.

A Lagrangian that is invariant under left multiplication of the pose by a constant element is a function of the body
velocity, in the Lie algebra. With an advected quantity ``a`` (such as gravity's direction in body axes),

    g'  = g xi
    mu' = coadjoint(xi) mu - K(a)^T dl/da + F,    mu = dl/dxi,    F the generalised force
    a'  = -K(a) xi,                               K(a) xi = d/de act(exp(e xi), a)

``-K^T dl/da`` is the diamond product of dl/da and a. Derivatives are CasADi's. F is the sum of a body force and of a
potential's, ``-(T_e L_g)^* dV`` (chapter 4.7.5, sign corrected). A system that is reduced from the right, ``g' = xi g``
(ideal fluids, chapter 4.4.7), is that of the inverse element with the velocity ``-xi``.

Chapter 4.2 to 4.6 and 4.17; Poincare, "Sur une forme nouvelle des equations de la mecanique", C. R. Acad. Sci. 132
(1901); Marsden and Ratiu, "Introduction to mechanics and symmetry" (1999), 13.5; Holm, Marsden, Ratiu, "The
Euler-Poincare equations and semidirect products", Advances in Mathematics 137 (1998).
"""

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import casadi as ca
import numpy as np

from lgmpc.compile import StageKernel
from lgmpc.errors import InputError, SolverError
from lgmpc.lie import checks
from lgmpc.mechanics.checks import frozen
from lgmpc.mechanics.groups import LieGroup, spatial_momentum
from lgmpc.typing import Array, numbers, typed

_INPUTS = ["time", "pose", "velocity", "advected", "parameters"]


@dataclass(frozen=True)
class Symbols:
    """The arguments of Lagrangians, forces and potentials: CasADi expressions.

    Attributes:
        time: s.
        pose: (size, size) group element; not for the Lagrangian, which is reduced.
        velocity: (dim,) body velocity.
        advected: (m,) advected quantity.
        parameters: (p,) constants of the system.
    """

    time: Any
    pose: Any
    velocity: Any
    advected: Any
    parameters: Any

    @property
    def arguments(self) -> list[Any]:
        """The attributes in order."""
        return [self.time, self.pose, self.velocity, self.advected, self.parameters]

    @property
    def state(self) -> Any:
        """The column ``[vec(pose); velocity; advected]``."""
        return state_of(self.pose, self.velocity, self.advected)


def state_of(pose: Any, velocity: Any, advected: Any) -> Any:
    """Return the column ``[vec(pose); velocity; advected]``."""
    return ca.densify(ca.vertcat(ca.vec(pose), velocity, advected))


Expression = Callable[[Symbols], Any]
"""A Lagrangian, potential or force: CasADi symbols to a CasADi expression."""


@dataclass(frozen=True)
class Advected:
    """A quantity in the Lagrangian that is constant in the world.

    Attributes:
        size: number of components.
        act: (element, a) -> a, a linear left action of the group, as an expression: the quantity ``a0`` in the world
            is ``act(g^-1, a0)`` in the body.
    """

    size: int
    act: Callable[[Any, Any], Any]


@dataclass(frozen=True)
class Motion:
    """A computed motion; a row per stored time.

    Attributes:
        times: (n,) s.
        poses: (n, size, size) group elements.
        velocities: (n, dim) of the body.
        advected: (n, m).
    """

    times: Array
    poses: Array
    velocities: Array
    advected: Array


Method = Callable[["EulerPoincare"], ca.Function]
"""From a system to one step: (time, step, x, p) -> x_next, with ``x = [vec(pose); velocity; advected]``."""


def runge_kutta4(field: Callable[[Any, Any], Any], y: Any, h: Any) -> Any:
    """Return ``y`` after one classical Runge-Kutta step of length ``h`` along ``y' = field(elapsed, y)``."""
    k1 = field(0.0, y)
    k2 = field(h / 2, y + h / 2 * k1)
    k3 = field(h / 2, y + h / 2 * k2)
    k4 = field(h, y + h * k3)
    return y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def munthe_kaas(system: "EulerPoincare") -> ca.Function:
    """Return the classical fourth-order step in the exponential chart around its initial pose.

    With ``g = g0 exp(z)``, ``z' = Jr^-1(z) xi``, for (z, xi); the advected quantity is transformed by exp(z), so that
    poses stay in the group and advected quantities in its orbit. Munthe-Kaas, "High order Runge-Kutta methods on
    manifolds", Applied Numerical Mathematics 29 (1999).
    """
    s, h, dim = system.symbols(), ca.SX.sym("step"), system.group.dim

    def slope(elapsed: Any, y: Any) -> Any:
        z, velocity = y[:dim], y[dim:]
        pose, advected = system.move(s.pose, z), system.carry(s.advected, z)
        rate = system.acceleration(s.time + elapsed, pose, velocity, advected, s.parameters)
        return ca.vertcat(system.group.symbolic.right_jacobian_inverse(z) @ velocity, rate)

    end = runge_kutta4(slope, ca.vertcat(ca.SX.zeros(dim), s.velocity), h)
    z, velocity = end[:dim], end[dim:]
    return system.step("munthe_kaas", s, h, system.move(s.pose, z), velocity, system.carry(s.advected, z))


@dataclass(frozen=True, eq=False)
class EulerPoincare:
    """A mechanical system on a group, reduced by left translations; see the module for the equations.

    Attributes:
        name: a C identifier, part of the names of compiled functions.
        group: the configuration space.
        lagrangian: reduced Lagrangian l(velocity, advected; parameters), J.
        advected: the advected quantity, if any.
        potential: V(pose; parameters), J.
        body_force: (dim,) generalised force on the body velocity.
        parameters: (p,) constants, which can change without recompilation.
    """

    name: str
    group: LieGroup
    lagrangian: Expression
    advected: Advected | None = None
    potential: Expression | None = None
    body_force: Expression | None = None
    parameters: Array = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", frozen(checks.finite("parameters", self.parameters).ravel()))
        symbols = self.symbols()
        if ca.depends_on(self.reduced(symbols), ca.vertcat(symbols.time, ca.vec(symbols.pose))):
            expected = "a function of velocity, advected quantity and parameters (other terms belong to the potential)"
            raise InputError("lagrangian", "one that depends on the pose or on time", expected)

    def move(self, pose: Any, displacement: Any) -> Any:
        """Return the pose displaced by z in the body, ``g exp(z)``."""
        return self.group.symbolic.compose(pose, self.group.symbolic.exp(displacement))

    def noether_momenta(self, motion: Motion) -> Array:
        """Return (n, dim) the spatial momenta, the momentum map of left translations."""
        return spatial_momentum(self.group, motion.poses, self.momenta(motion))

    def symbols(self) -> Symbols:
        """Return fresh symbols of the system's sizes."""
        size, carried = self.group.size, 0 if self.advected is None else self.advected.size
        return Symbols(
            ca.SX.sym("time"),
            ca.SX.sym("pose", size, size),
            ca.SX.sym("velocity", self.group.dim),
            ca.SX.sym("advected", carried),
            ca.SX.sym("parameters", self.parameters.size),
        )

    def reduced(self, symbols: Symbols) -> Any:
        """Return the reduced Lagrangian as an SX scalar.

        Raises:
            InputError: it is no scalar.
        """
        value = ca.SX(self.lagrangian(symbols))
        if value.shape != (1, 1):
            raise InputError("lagrangian", f"an expression of shape {value.shape}", "a scalar")
        return value

    def generator(self, advected: Any) -> Any:
        """Return (m, dim) the matrix K(a): ``K(a) xi`` is the rate at which ``exp(t xi)`` moves a."""
        if self.advected is None:
            return ca.SX(0, self.group.dim)
        xi = ca.SX.sym("xi", self.group.dim)
        moved = self.advected.act(self.group.symbolic.exp(xi), advected)
        return ca.substitute(ca.jacobian(moved, xi), xi, 0)

    def generalised_force(self, symbols: Symbols) -> Any:
        """Return (dim,) the generalised force, including the potential's: ``-d/dz V(g exp(z))``."""
        total = ca.SX.zeros(self.group.dim) + (0.0 if self.body_force is None else self.body_force(symbols))
        if self.potential is None:
            return total
        z = ca.SX.sym("z", self.group.dim)
        moved = replace(symbols, pose=self.move(symbols.pose, z))
        return total - ca.substitute(ca.gradient(self.potential(moved), z), z, 0)

    def carry(self, advected: Any, displacement: Any) -> Any:
        """Return the advected quantity after a displacement z of the body: ``act(exp(-z), a)``."""
        if self.advected is None:
            return advected
        return self.advected.act(self.group.symbolic.exp(-displacement), advected)

    @functools.cached_property
    def loads(self) -> ca.Function:
        """(time, pose, velocity, advected, parameters) -> (dim,) ``-K(a)^T dl/da + F``, mu' without the bracket."""
        s = self.symbols()
        total = self.generalised_force(s)
        if self.advected is not None:
            total -= self.generator(s.advected).T @ ca.gradient(self.reduced(s), s.advected)
        return self.function("loads", s, load=total)

    @functools.cached_property
    def acceleration(self) -> ca.Function:
        """(time, pose, velocity, advected, parameters) -> rate of the velocity, the equation of the module solved."""
        s = self.symbols()
        lagrangian = self.reduced(s)
        momentum = ca.gradient(lagrangian, s.velocity)
        generator = self.generator(s.advected)
        rate = self.group.symbolic.coadjoint(s.velocity) @ momentum + self.loads(*s.arguments)
        carried = ca.jacobian(momentum, s.advected) @ (-generator @ s.velocity)
        mass = ca.densify(ca.jacobian(momentum, s.velocity))
        return self.function("acceleration", s, rate=ca.ldl_solve(rate - carried, *ca.ldl(mass)))

    @functools.cached_property
    def observables(self) -> ca.Function:
        """(time, pose, velocity, advected, parameters) -> momentum (dim,), energy ``<mu, xi> - l + V``."""
        s = self.symbols()
        lagrangian = self.reduced(s)
        momentum = ca.gradient(lagrangian, s.velocity)
        energy = ca.dot(momentum, s.velocity) - lagrangian
        if self.potential is not None:
            energy += self.potential(s)
        return self.function("observables", s, momentum=momentum, energy=energy)

    def function(self, name: str, s: Symbols, **outputs: Any) -> ca.Function:
        """Return expressions as a function (time, pose, velocity, advected, parameters) with named outputs."""
        return ca.Function(
            f"{self.name}_{name}", s.arguments, [*map(ca.densify, outputs.values())], _INPUTS, [*outputs]
        )

    def step(self, method: str, s: Symbols, h: Any, pose: Any, velocity: Any, advected: Any) -> ca.Function:
        """Return a method's step as a function (time, step, x, p) -> x_next, ``x = [vec(pose); velocity; advected]``.

        Args:
            method: its name, a C identifier.
            s: symbols at the step's beginning.
            h: symbol of its length.
            pose: expression (size, size) at its end.
            velocity: (dim,) at its end.
            advected: (m,) at its end.
        """
        inputs = [s.time, h, s.state, s.parameters]
        x_next = state_of(pose, velocity, advected)
        return ca.Function(f"{self.name}_{method}", inputs, [x_next], ["time", "step", "x", "p"], ["x_next"])

    @functools.cached_property
    def _kernels(self) -> dict[Method | str, StageKernel]:
        return {}

    @typed
    def simulate(
        self,
        pose: Array,
        velocity: Array,
        advected: Array | None = None,
        *,
        step: float,
        steps: int,
        every: int = 1,
        method: Method = munthe_kaas,
    ) -> Motion:
        """Integrate from time 0: one call of compiled code for thousands of steps.

        Args:
            pose: (size, size) element at the start.
            velocity: (dim,) at the start.
            advected: (m,) at the start, in the Lagrangian's frame.
            step: length of a step, s.
            steps: their number.
            every: number of steps between two stored ones; divides ``steps``.
            method: of :mod:`lgmpc.mechanics.integrators`; fourth order, on the group, unless given.

        Raises:
            InputError: an argument of the wrong shape, not finite, not in the group; a step that is not positive; a
                system that the method does not support; or a Lagrangian whose mass matrix at the start is not positive
                definite.
            SolverError: the motion did not stay finite.
        """
        if not (math.isfinite(step) and step > 0.0):
            raise InputError("step", step, "a positive length of time, s")
        if steps < 1:
            raise InputError("steps", steps, "a whole number, at least one")
        if every < 1 or steps % every:
            raise InputError("every", every, f"a divisor of the number of steps, {steps}")
        size, dim = self.group.size, self.group.dim
        g = self.group.check_element("pose", pose)
        xi = self.group.check_tangent("velocity", velocity)
        expected = 0 if self.advected is None else self.advected.size
        a = numbers("advected", np.zeros(0) if advected is None else advected, (expected,), finite=True)
        self._check_mass(g, xi, a)
        start = np.concatenate((g.ravel(order="F"), xi, a))
        if method not in self._kernels:
            self._kernels[method] = StageKernel(method(self))
        states, times = np.empty((steps + 1, start.size)), step * np.arange(steps + 1, dtype=np.float64)
        states[0] = start
        kernel, steady = self._kernels[method], {"step": np.array([step]), "p": self.parameters}
        kernel.bind(steps, time=times[:-1, None], x=states[:-1], x_next=states[1:], **steady)()
        if not np.isfinite(states[-1]).all():
            raise SolverError("simulate", "the state did not stay finite", "Take a shorter step")
        times, rows = times[::every], states[::every].copy()
        poses = rows[:, : size * size].reshape(-1, size, size).transpose(0, 2, 1)
        return Motion(times, poses, rows[:, size * size : size * size + dim], rows[:, size * size + dim :])

    def momenta(self, motion: Motion) -> Array:
        """Return (n, dim) the body momenta ``dl/dxi`` along a motion."""
        return self.along(motion, self.observables)[0]

    def energies(self, motion: Motion) -> Array:
        """Return (n,) ``<mu, xi> - l + V`` along a motion, J."""
        return self.along(motion, self.observables)[1][:, 0]

    def along(self, motion: Motion, function: ca.Function) -> list[Array]:
        """Return the values (n, size) along a motion of a function of the arguments of :attr:`acceleration`."""
        if function.name() not in self._kernels:
            self._kernels[function.name()] = StageKernel(function)
        kernel, count = self._kernels[function.name()], len(motion.times)
        poses = motion.poses.transpose(0, 2, 1).reshape(count, -1)
        given = (motion.times[:, None], poses, motion.velocities, motion.advected)
        inputs = dict(zip(_INPUTS, (*map(np.ascontiguousarray, given), self.parameters), strict=True))
        outputs = {name: np.empty((count, size)) for name, size in kernel.output_sizes.items()}
        kernel.bind(count, **inputs, **outputs)()
        return list(outputs.values())

    def _check_mass(self, pose: Array, velocity: Array, advected: Array) -> None:
        s = self.symbols()
        curvature = ca.hessian(self.reduced(s), s.velocity)[0]
        mass = ca.Function("mass", s.arguments, [curvature])(0.0, pose, velocity, advected, self.parameters).full()
        lowest = float(np.linalg.eigvalsh(mass)[0]) if np.isfinite(mass).all() else np.nan
        if not lowest > 0.0:
            expected = "a Lagrangian whose second derivative by the velocity is positive definite at the start"
            raise InputError("lagrangian", f"a second derivative with lowest eigenvalue {lowest:.3g}", expected)
