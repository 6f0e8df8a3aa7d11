"""The symbolic algorithms of one ``pin.Model``."""

from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import casadi as ca
import pinocchio as pin

from lgmpc.errors import InputError
from lgmpc.robot.symbolic import dynamics, frames, passes
from lgmpc.robot.symbolic.factor import MassFactor
from lgmpc.robot.symbolic.passes import Placement
from lgmpc.robot.symbolic.tree import read_tree
from lgmpc.state import integrate_configuration_symbolic

T = TypeVar("T")

_KEPT = 8
"""Number of cached results of each recursion."""


class SymbolicModel:
    """Rigid-body algorithms over a ``pin.Model`` as CasADi expressions.

    Arguments and results are SX columns (or DM); for MX, wrap the expressions in a Function. The values are
    Pinocchio's: the dynamics include the armature, twists and wrenches are linear first, and quaternions must be of
    unit norm. Methods with the same arguments share intermediate results: mass matrix and centre of mass of the same
    ``q`` use one set of placements. Matrix entries that vanish for any configuration, such as those between branches,
    are structurally zero.

    ``frame`` is a name or an index of ``model.frames``; ``reference`` one of ``pin.LOCAL`` (the frame's own axes),
    ``pin.LOCAL_WORLD_ALIGNED`` (world axes at the frame's origin) and ``pin.WORLD`` (world axes at the world's origin).
    ``external`` maps frames to forces (3,) or wrenches (6,) that act on the robot at the frame's origin, world axes.

    Sources: Featherstone, Rigid Body Dynamics Algorithms (2008); Luh, Walker and Paul (1980) for the accelerations;
    Orin, Goswami and Lee (2013) for the centroidal momentum.

    Args:
        model: a model of free-flyer, spherical, revolute, continuous and prismatic joints.

    Attributes:
        nq: size of the configuration.
        nv: size of the velocity.
        mass: of all moving bodies, kg.

    Raises:
        ModelError: a joint of another kind; all such are listed.
    """

    def __init__(self, model: pin.Model) -> None:
        self.model = model
        self._tree = tree = read_tree(model)
        self.nq, self.nv, self.mass = tree.nq, tree.nv, tree.mass
        self._frames: dict[int | str, frames.Frame] = {}
        self._known: dict[str, list[tuple[tuple[Any, ...], Any]]] = {}

    def __reduce__(self) -> "tuple[type[SymbolicModel], tuple[pin.Model]]":
        """Restore without the intermediate results."""
        return SymbolicModel, (self.model,)

    # Configurations

    def integrate(self, q: Any, dv: Any) -> Any:
        """Return (nq,) ``q (+) dv``."""
        return integrate_configuration_symbolic(
            self.model, self._column(q, self.nq, "q"), self._column(dv, self.nv, "dv")
        )

    # Kinematics

    def joint_placement(self, q: Any, joint: int) -> Placement:
        """Return the placement in the world of Pinocchio's joint number ``joint``."""
        return self._placed(q)[joint]

    def frame_placement(self, q: Any, frame: int | str) -> Placement:
        """Return the placement of ``frame`` in the world."""
        found = self._frame(frame)
        return self._placed(q)[found.joint].compose(found.placement)

    def frame_jacobian(self, q: Any, frame: int | str, reference: Any = pin.LOCAL_WORLD_ALIGNED) -> Any:
        """Return (6, nv) the Jacobian of ``frame``: its product with v is :meth:`frame_velocity`."""
        return frames.jacobian(self._tree, self._frame(frame), self._steps(q), self._placed(q), reference, q)

    def frame_velocity(self, q: Any, v: Any, frame: int | str, reference: Any = pin.LOCAL_WORLD_ALIGNED) -> Any:
        """Return (6,) [linear; angular] velocity of ``frame``, m/s and rad/s."""
        return frames.velocity(self._frame(frame), self._placed(q), self._turning(q, v), self._moving(q, v), reference)

    def frame_acceleration(
        self, q: Any, v: Any, a: Any, frame: int | str, reference: Any = pin.LOCAL_WORLD_ALIGNED
    ) -> Any:
        """Return (6,) [classical linear; angular] acceleration of ``frame``, m/s2 and rad/s2.

        The linear part is the second derivative of its origin's position, not the spatial acceleration.

        Raises:
            InputError: ``reference`` is WORLD.
        """
        return frames.acceleration(self._frame(frame), self._placed(q), self._accelerating(q, v, a), reference)

    def frame_drift(self, q: Any, v: Any, frame: int | str, reference: Any = pin.LOCAL_WORLD_ALIGNED) -> Any:
        """Return (6,) :meth:`frame_acceleration` at zero joint accelerations.

        With the LOCAL_WORLD_ALIGNED Jacobian J it is ``dJ/dt v``. With LOCAL it is the same in the frame's axes.

        Raises:
            InputError: ``reference`` is WORLD.
        """
        return self.frame_acceleration(q, v, None, frame, reference)

    # Centre of mass and centroidal momentum

    def com(self, q: Any) -> Any:
        """Return (3,) the centre of mass, world axes, m."""
        return dynamics.center_of_mass(self._tree, self._gathered(q), self._steps(q))

    def vcom(self, q: Any, v: Any) -> Any:
        """Return (3,) velocity of the centre of mass, world axes, m/s."""
        return self.momentum(q, v)[:3] / self.mass

    def jacobian_com(self, q: Any) -> Any:
        """Return (3, nv) the Jacobian of the centre of mass: its product with v is :meth:`vcom`."""
        return self.momentum_matrix(q)[:3, :] / self.mass

    def momentum_matrix(self, q: Any) -> Any:
        """Return (6, nv) the centroidal momentum matrix A_G: its product with v is :meth:`momentum`."""
        return dynamics.momentum_columns(self._tree, self._gathered(q), self._steps(q), self._mass_matrix(q)[1])

    def momentum(self, q: Any, v: Any) -> Any:
        """Return (6,) the centroidal momentum [linear; angular], world axes, kg.m/s and kg.m2/s."""
        momenta = dynamics.root_momenta(self._tree, self._steps(q), self._turning(q, v), self._moving(q, v))
        return dynamics.momentum_at_center(self._tree, self._gathered(q), self._steps(q), momenta)

    def momentum_rate(self, q: Any, v: Any, a: Any) -> Any:
        """Return (6,) the time derivative of :meth:`momentum`; ``a`` None is zero acceleration: dA_G/dt v."""
        wrenches = dynamics.net_wrenches(self._tree, self._steps(q), self._accelerating(q, v, a), {})
        rates = {root: wrenches[root] for root in self._tree.roots}
        return dynamics.momentum_at_center(self._tree, self._gathered(q), self._steps(q), rates)

    # Dynamics

    def rnea(self, q: Any, v: Any, a: Any, external: Mapping[int | str, Any] | None = None) -> Any:
        """Return (nv,) the generalised forces of an acceleration ``a``: M a + nle - sum of J^T external."""
        accelerating = self._accelerating(q, v, a, gravity=True)
        wrenches = dynamics.net_wrenches(self._tree, self._steps(q), accelerating, self._external(q, external))
        return dynamics.joint_torques(self._tree, wrenches, a)

    def nle(self, q: Any, v: Any) -> Any:
        """Return (nv,) the nonlinear effects: Coriolis, centrifugal and gravity forces."""
        return self.rnea(q, v, None)

    def gravity(self, q: Any) -> Any:
        """Return (nv,) the generalised forces that balance gravity."""
        return self.rnea(q, type(q).zeros(self.nv), None)

    def crba(self, q: Any) -> Any:
        """Return (nv, nv) the mass matrix M, both triangles, armature included."""
        return type(q)(self._mass_matrix(q)[0])  # a copy: CasADi matrices can be changed in place

    def mass_factor(self, q: Any) -> MassFactor:
        """Return a factor of M without fill-in, for products with its inverse: forward dynamics, M^-1 J^T."""
        return self._remember("factor", (q,), lambda: MassFactor(self.crba(q)))

    # Shared recursions

    def _steps(self, q: Any) -> list[Placement]:
        return self._remember("steps", (q,), lambda: passes.joint_steps(self._tree, self._column(q, self.nq, "q")))

    def _placed(self, q: Any) -> list[Placement]:
        return self._remember("placed", (q,), lambda: passes.world_placements(self._tree, self._steps(q)))

    def _turning(self, q: Any, v: Any) -> list[passes.Rotation]:
        return self._remember(
            "turning", (q, v), lambda: passes.rotations(self._tree, self._steps(q), self._column(v, self.nv, "v"))
        )

    def _moving(self, q: Any, v: Any) -> list[Any]:
        return self._remember(
            "moving", (q, v), lambda: passes.linear_velocities(self._tree, self._steps(q), self._turning(q, v), v)
        )

    def _accelerating(self, q: Any, v: Any, a: Any, gravity: bool = False) -> list[passes.Acceleration]:
        base = -self._tree.gravity if gravity else ca.DM.zeros(3)
        key = (q, v) if a is None else (q, v, self._column(a, self.nv, "a"))
        return self._remember(
            f"accelerating {gravity}",
            key,
            lambda: passes.accelerations(self._tree, self._steps(q), self._turning(q, v), v, a, base),
        )

    def _gathered(self, q: Any) -> list[passes.Composite]:
        return self._remember("gathered", (q,), lambda: passes.composites(self._tree, self._steps(q)))

    def _mass_matrix(self, q: Any) -> tuple[Any, list[tuple[int, dynamics.Wrench]]]:
        return self._remember(
            "mass matrix",
            (q,),
            lambda: dynamics.mass_matrix(
                self._tree, self._steps(q), dynamics.composite_forces(self._tree, self._gathered(q)), q
            ),
        )

    def _external(self, q: Any, external: Mapping[int | str, Any] | None) -> dict[int, dynamics.Wrench]:
        total: dict[int, dynamics.Wrench] = {}
        for name, wrench in (external or {}).items():
            frame = self._frame(name)
            force, moment = frames.local_wrench(frame, self._placed(q), wrench)
            before = total.get(frame.joint)
            total[frame.joint] = (force, moment) if before is None else (before[0] + force, before[1] + moment)
        return total

    def _frame(self, frame: int | str) -> frames.Frame:
        if frame not in self._frames:
            self._frames[frame] = frames.read_frame(self.model, frame)
        return self._frames[frame]

    def _column(self, value: Any, size: int, argument: str) -> Any:
        if value.shape != (size, 1):
            raise InputError(argument, f"a CasADi matrix of shape {value.shape}", f"a column of {size}")
        return value

    def _remember(self, name: str, arguments: tuple[Any, ...], compute: Callable[[], T]) -> T:
        """Return the result of ``compute`` for these expressions, from the cache if it is among the last few."""
        known = self._known.setdefault(name, [])
        for seen, result in known:
            if len(seen) == len(arguments) and all(map(_same, seen, arguments)):
                return result
        result = compute()
        known.append((arguments, result))
        del known[:-_KEPT]
        return result


def _same(one: Any, other: Any) -> bool:
    """Return whether two matrices are the same expression, entry by entry (for DM: the same numbers)."""
    return one is other or (type(one) is type(other) and one.shape == other.shape and ca.is_equal(one, other, 0))
