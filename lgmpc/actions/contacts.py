"""A set of contacts of a robot's frames with the ground, switched by flags that are parameters."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin

from lgmpc.costs import Parameter
from lgmpc.errors import InputError
from lgmpc.lie.symbolic import quaternion, so3
from lgmpc.robot.names import frame_index
from lgmpc.robot.symbolic import Factored, LdlFactor, MassFactor, SymbolicModel
from lgmpc.typing import instance, numbers

Axis = tuple[float, float, float]
_AXES: dict[int, tuple[Axis, ...]] = {1: ((0.0, 0.0, 1.0),), 2: ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0))}


@dataclass(frozen=True)
class Contact:
    """A frame in contact with the ground.

    A contact of size 1 or 2 holds its origin along some axes, and slides without friction along the others: z, or x and
    z, of the world unless others are given. Axes of the frame turn with it: the axle of a wheel or of a skate
    (a nonholonomic constraint); along these only the velocity is held, not the position.

    Attributes:
        frame: its name.
        size: 1 or 2 constrain its origin along axes, 3 along all (a point), 6 its orientation too (a surface).
        axes: directions of the world that a contact of size 1 or 2 holds; of any length, stored as unit vectors.
        frame_axes: directions of the frame that it holds.

    Raises:
        InputError: another size, or axes that do not suit it.
    """

    frame: str
    size: int = 3
    axes: tuple[Axis, ...] = ()
    frame_axes: tuple[Axis, ...] = ()

    def __post_init__(self) -> None:
        instance("frame", self.frame, str, "the name of a frame")
        instance("size", self.size, (int, np.integer), "1 or 2 for some axes, 3 for a point, 6 for a surface")
        if self.size not in (1, 2, 3, 6):
            raise InputError("size", self.size, "1 or 2 for some axes, 3 for a point, 6 for a surface")
        for name in ("axes", "frame_axes"):
            instance(name, getattr(self, name), (tuple, list, np.ndarray), "a list of directions of three numbers")
        given = len(self.axes) + len(self.frame_axes)
        if given == 0:
            object.__setattr__(self, "axes", _AXES.get(self.size, ()))
            return
        for name in ("axes", "frame_axes"):
            object.__setattr__(self, name, _unit_vectors(name, getattr(self, name)))
        if self.size not in _AXES or given != self.size:
            expected = f"{self.size} in all" if self.size in _AXES else f"none for a contact of size {self.size}"
            raise InputError("axes, frame_axes", f"{given} axes", expected)
        if any(np.linalg.matrix_rank(np.array(axes), 1e-6) < len(axes) for axes in (self.axes, self.frame_axes)):
            raise InputError("axes, frame_axes", self.axes + self.frame_axes, "two directions that are not parallel")

    def along(self, column: Any, rotation: Any) -> Any:
        """Return the entries that are held (size, m) of a quantity in world axes (6, m).

        Args:
            column: [linear; angular], at the frame's origin.
            rotation: (3, 3) of the frame in the world.
        """
        return self.directions(rotation).T @ column[:3, :] if self.size in _AXES else column[: self.size, :]

    def directions(self, rotation: Any) -> Any:
        """Return the axes (3, size) in the world, of a contact of size 1 or 2."""
        world, own = (ca.DM(np.array(axes).reshape(-1, 3).T) for axes in (self.axes, self.frame_axes))
        return ca.horzcat(world, rotation @ own)


def _unit_vectors(name: str, axes: Sequence[Axis]) -> tuple[Axis, ...]:
    vectors = [numbers(name, axis) for axis in axes]
    lengths = [float(np.linalg.norm(vector)) for vector in vectors]
    if any(vector.shape != (3,) or not 0.0 < length < np.inf for vector, length in zip(vectors, lengths, strict=True)):
        raise InputError(name, axes, "directions of three numbers, of a length above zero")
    return tuple(tuple((v / n).tolist()) for v, n in zip(vectors, lengths, strict=True))


class ContactSet:
    """Jacobians, accelerations and the common linear solve of contacts, in world axes at each frame's origin.

    With the flags phi (1 in contact, 0 in the air) on the diagonal of Phi, the equations

        M y - J^T Phi f = r1,        Phi J y + (1 - Phi + damping) f = r2

    are regular for any flags, and give a contact in the air exactly zero force where its row of r2 is zero.

    Args:
        model: the robot.
        contacts: names of frames (points) or contacts.

    Attributes:
        contacts: in order.
        nf: number of force components.
        parameters: of all contacts.

    Raises:
        InputError: no contact, an unknown frame, or one named twice.
    """

    def __init__(self, model: pin.Model, contacts: Sequence[str | Contact]) -> None:
        instance("model", model, pin.Model, "a pinocchio.Model")
        instance("contacts", contacts, (tuple, list), "a list of frames' names and contacts")
        self.contacts = tuple(Contact(c) if isinstance(c, str) else c for c in contacts)
        for i, contact in enumerate(self.contacts):
            instance(f"contacts[{i}]", contact, Contact, "a frame's name, or a Contact")
        if not self.contacts:
            raise InputError("contacts", "none", "at least one (without contacts use FreeForwardDynamics)")
        for i, contact in enumerate(self.contacts):
            frame_index(model, contact.frame)
            if any(other.frame == contact.frame for other in self.contacts[:i]):
                raise InputError("contacts", f"{contact.frame} twice", "each frame once")
        self.nf = sum(contact.size for contact in self.contacts)
        n = len(self.contacts)
        turned = sum(contact.size == 6 for contact in self.contacts)
        self.parameters = (
            Parameter("contact_flags", n, "1 in contact, 0 in the air", 1.0),
            Parameter(
                "contact_damping", 1, "compliance added to the contacts' inverse inertia, 1/kg", sign="not negative"
            ),
        )
        self.anchors: tuple[Parameter, ...] = (
            Parameter("contact_points", 3 * n, "points at which the contact frames' origins are held, world, m"),
            Parameter(
                "contact_gains",
                2 * n,
                "Baumgarte stiffness (1/s2) and damping (1/s) towards contact_points, of each contact; two for all",
                sign="not negative",
                part=2,
            ),
        )
        if turned:
            meaning = "orientations at which surface contacts are held, quaternions x y z w"
            self.anchors += (Parameter("contact_orientations", 4 * turned, meaning, [0.0, 0.0, 0.0, 1.0] * turned),)

    def jacobian(self, robot: SymbolicModel, q: Any) -> Any:
        """Return (nf, nv) J."""
        rows = (c.along(robot.frame_jacobian(q, c.frame), self._rotation(robot, q, c)) for c in self.contacts)
        return ca.vertcat(ca.SX(0, robot.nv), *rows)

    def velocity(self, robot: SymbolicModel, q: Any, v: Any) -> Any:
        """Return (nf,) J v."""
        rows = (c.along(robot.frame_velocity(q, v, c.frame), self._rotation(robot, q, c)) for c in self.contacts)
        return ca.vertcat(ca.SX(0, 1), *rows)

    def acceleration(self, robot: SymbolicModel, q: Any, v: Any, a: Any, values: Mapping[str, Any]) -> Any:
        """Return (nf,) accelerations of the contacts plus Baumgarte's terms, zero for contacts at rest at their points.

        ``J a + dJ/dt v + stiffness (p - p_held) + damping J v`` (Baumgarte 1972); of orientations ``log(R R_held^T)``.
        Along axes that turn with the frame no position is held.
        """
        rows, surface = [ca.SX(0, 1)], 0
        for i, contact in enumerate(self.contacts):
            stiffness, damping = values["contact_gains"][2 * i], values["contact_gains"][2 * i + 1]
            placement = robot.frame_placement(q, contact.frame)
            error = self.error(robot, q, i, values)
            if contact.size == 6:
                held = quaternion.to_matrix(values["contact_orientations"][4 * surface : 4 * surface + 4])
                error = ca.vertcat(error, so3.log(placement.rotation @ held.T))
                surface += 1
            rate = robot.frame_velocity(q, v, contact.frame)
            moved = contact.along(robot.frame_acceleration(q, v, a, contact.frame), placement.rotation)
            if contact.frame_axes:
                # The axes' own rates: d(n . v)/dt = n . a + (omega x n) . v
                own = placement.rotation @ ca.DM(np.array(contact.frame_axes).T)
                moved += ca.vertcat(ca.SX(len(contact.axes), 1), (so3.hat(rate[3:]) @ own).T @ rate[:3])
            rows.append(moved + stiffness * error + damping * contact.along(rate, placement.rotation))
        return ca.vertcat(*rows)

    def error(self, robot: SymbolicModel, q: Any, i: int, values: Mapping[str, Any]) -> Any:
        """Return the distances of contact i from its point in ``contact_points``, (3,) or along its axes; m."""
        contact = self.contacts[i]
        placement = robot.frame_placement(q, contact.frame)
        apart = placement.translation - values["contact_points"][3 * i : 3 * i + 3]
        if contact.size >= 3:
            return apart
        held = ca.DM(np.array(contact.axes).reshape(-1, 3))
        return ca.vertcat(held @ apart, ca.SX(len(contact.frame_axes), 1))

    def flags(self, values: Mapping[str, Any]) -> Any:
        """Return (nf,) the flag of each force component."""
        given = values["contact_flags"]
        return ca.vertcat(ca.SX(0, 1), *(ca.repmat(given[i], c.size, 1) for i, c in enumerate(self.contacts)))

    def by_frame(self, forces: Any, robot: SymbolicModel, q: Any) -> dict[int | str, Any]:
        """Return the forces (3,) or wrenches (6,) on each frame, world axes, of the force components (nf,)."""
        found: dict[int | str, Any] = {}
        start = 0
        for contact in self.contacts:
            own = forces[start : start + contact.size]
            found[contact.frame] = (
                own if contact.size >= 3 else contact.directions(self._rotation(robot, q, contact)) @ own
            )
            start += contact.size
        return found

    def _rotation(self, robot: SymbolicModel, q: Any, contact: Contact) -> Any:
        return robot.frame_placement(q, contact.frame).rotation

    def solver(self, robot: SymbolicModel, q: Any, values: Mapping[str, Any]) -> "ContactSolver":
        """Return the solver of the equations above at a configuration."""
        return ContactSolver(robot.crba(q), self.jacobian(robot, q), self.flags(values), values["contact_damping"])


class ContactSolver(Factored):
    """Solves the equations of :class:`ContactSet` through the Schur complement of M.

    With ``M = L D L^T``, leaves first so that L has no more entries than M, and ``Y = L^-1 J^T Phi``, every step keeps
    the zeros between branches: ``(Y^T D^-1 Y + 1 - Phi + damping) f = r2 - Y^T D^-1 L^-1 r1`` and
    ``y = L^-T D^-1 (L^-1 r1 + Y f)``.

    Args:
        mass: (nv, nv) M.
        jacobian: (nf, nv) J.
        flags: (nf,).
        damping: the compliance.
    """

    def __init__(self, mass: Any, jacobian: Any, flags: Any, damping: Any) -> None:
        self._mass = MassFactor(mass)
        half = self._mass.forward((ca.diag(flags) @ jacobian).T)
        complement = ca.triu2symm(ca.triu(half.T @ self._mass.scale(half))) + ca.diag(1 - flags + damping)
        self._schur = LdlFactor(complement)
        self.matrices = (*self._mass.matrices, half, *self._schur.matrices)

    def solve(self, right: Any) -> Any:
        """Return [y; f] (nv + nf, m) for right-hand sides [r1; r2] (nv + nf, m)."""
        upper, reciprocal, coupling, *schur = self.matrices
        mass, nv = self._mass.with_matrices(upper, reciprocal), upper.shape[0]
        half = mass.forward(right[:nv, :])
        forces = self._schur.with_matrices(*schur).solve(right[nv:, :] - coupling.T @ mass.scale(half))
        return ca.vertcat(mass.back(mass.scale(half + coupling @ forces)), forces)
