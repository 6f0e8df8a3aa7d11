"""A set of contacts of a robot's frames with the ground, switched by flags that are parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import pinocchio as pin

from lgmpc.costs import Parameter
from lgmpc.errors import InputError
from lgmpc.lie.symbolic import quaternion, so3
from lgmpc.robot.names import frame_index
from lgmpc.robot.symbolic import Factored, LdlFactor, MassFactor, SymbolicModel

__all__ = ["Contact", "ContactSet"]


@dataclass(frozen=True)
class Contact:
    """A frame in contact with the ground.

    Attributes:
        frame: its name.
        size: 3 constrains its origin (a point), 6 its orientation too (a surface).

    Raises:
        InputError: another size.
    """

    frame: str
    size: int = 3

    def __post_init__(self) -> None:
        if self.size not in (3, 6):
            raise InputError("size", self.size, "3 for a point, 6 for a surface")


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
        self.contacts = tuple(Contact(c) if isinstance(c, str) else c for c in contacts)
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
            Parameter("contact_points", 3 * n, "where the contact frames' origins are held, world, m"),
            Parameter(
                "contact_gains",
                2,
                "Baumgarte stiffness (1/s2) and damping (1/s) towards contact_points",
                sign="not negative",
            ),
        )
        if turned:
            meaning = "how surface contacts are held, quaternions x y z w"
            self.anchors += (Parameter("contact_orientations", 4 * turned, meaning, [0.0, 0.0, 0.0, 1.0] * turned),)

    def jacobian(self, robot: SymbolicModel, q: Any) -> Any:
        """Return (nf, nv) J."""
        return ca.vertcat(ca.SX(0, robot.nv), *(robot.frame_jacobian(q, c.frame)[: c.size, :] for c in self.contacts))

    def velocity(self, robot: SymbolicModel, q: Any, v: Any) -> Any:
        """Return (nf,) J v."""
        return ca.vertcat(ca.SX(0, 1), *(robot.frame_velocity(q, v, c.frame)[: c.size] for c in self.contacts))

    def acceleration(self, robot: SymbolicModel, q: Any, v: Any, a: Any, values: Mapping[str, Any]) -> Any:
        """Return (nf,) accelerations of the contacts plus Baumgarte's terms, zero for contacts at rest in their place.

        ``J a + dJ/dt v + stiffness (p - p_held) + damping J v`` (Baumgarte 1972); of orientations ``log(R R_held^T)``.
        """
        stiffness, damping = values["contact_gains"][0], values["contact_gains"][1]
        rows, surface = [ca.SX(0, 1)], 0
        for i, contact in enumerate(self.contacts):
            placement = robot.frame_placement(q, contact.frame)
            error = placement.translation - values["contact_points"][3 * i : 3 * i + 3]
            if contact.size == 6:
                held = quaternion.to_matrix(values["contact_orientations"][4 * surface : 4 * surface + 4])
                error = ca.vertcat(error, so3.log(placement.rotation @ held.T))
                surface += 1
            rate = robot.frame_velocity(q, v, contact.frame)[: contact.size]
            moved = robot.frame_acceleration(q, v, a, contact.frame)[: contact.size]
            rows.append(moved + stiffness * error + damping * rate)
        return ca.vertcat(*rows)

    def flags(self, values: Mapping[str, Any]) -> Any:
        """Return (nf,) the flag of each force component."""
        given = values["contact_flags"]
        return ca.vertcat(ca.SX(0, 1), *(ca.repmat(given[i], c.size, 1) for i, c in enumerate(self.contacts)))

    def by_frame(self, forces: Any) -> dict[int | str, Any]:
        """Split (nf,) force components by frame."""
        found: dict[int | str, Any] = {}
        start = 0
        for contact in self.contacts:
            found[contact.frame] = forces[start : start + contact.size]
            start += contact.size
        return found

    def solver(self, robot: SymbolicModel, q: Any, values: Mapping[str, Any]) -> ContactSolver:
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
