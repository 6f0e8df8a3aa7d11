"""As many momenta are conserved as there are symmetries; a wrong number is detected."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import pytest

from lgmpc.demos import symmetry
from lgmpc.mechanics import free_body


def test_what_is_symmetric_is_conserved() -> None:
    outcome = symmetry.run()
    assert outcome.agrees, [row for row in outcome.rows if not row.agrees]
    stay = [row.measured for row in outcome.rows if row.quantity.endswith("conserved momenta")]
    assert stay == [6, 3, 3, 1, 0, 1]
    assert outcome.times is not None
    assert all(len(body.positions) == len(body.rotations) == len(outcome.times) for body in outcome.bodies)


def test_a_force_that_is_not_in_the_lagrangian_is_detected(monkeypatch: pytest.MonkeyPatch) -> None:
    """Friction breaks the Lagrangian's symmetries."""
    free, *others = symmetry._CASES
    rough = free_body(symmetry._BOX, body_force=lambda s: ca.DM([1e-3, 0.0, 0.0, 0.0, 0.0, 0.0]))
    monkeypatch.setattr(symmetry, "_CASES", (replace(free, system=rough), *others))
    wrong = {row.quantity for row in symmetry.run().rows if not row.agrees}
    assert wrong == {"free: conserved momenta", "free: relative change of these"}


def test_a_wrong_number_of_symmetries_is_detected(monkeypatch: pytest.MonkeyPatch) -> None:
    """The chapter's table counts one symmetry on a plane."""
    cases = [replace(c, symmetries=1) if "plane" in c.name else c for c in symmetry._CASES]
    monkeypatch.setattr(symmetry, "_CASES", tuple(cases))
    wrong = {row.quantity for row in symmetry.run().rows if not row.agrees}
    assert wrong == {"on an elastic, level plane: symmetries"}
