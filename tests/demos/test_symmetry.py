"""As many momenta stay as there are symmetries; a symmetry that is claimed but not there is detected."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import pytest

from lgmpc.demos import symmetry
from lgmpc.mechanics import free_body


def test_what_is_symmetric_is_conserved() -> None:
    outcome = symmetry.run()
    assert outcome.agrees, [row for row in outcome.rows if not row.agrees]
    stay = [row.measured for row in outcome.rows if row.quantity.endswith("momenta that stay")]
    assert stay == [6, 3, 3, 1, 0, 1]
    assert outcome.times is not None
    assert all(len(body.positions) == len(body.rotations) == len(outcome.times) for body in outcome.bodies)


def test_a_force_that_is_not_in_the_lagrangian_is_detected(monkeypatch: pytest.MonkeyPatch) -> None:
    """Friction breaks what the Lagrangian promises."""
    free, *others = symmetry._CASES
    rough = free_body(symmetry._BOX, spatial_force=lambda s: ca.DM([1e-3, 0.0, 0.0, 0.0, 0.0, 0.0]))
    monkeypatch.setattr(symmetry, "_CASES", (replace(free, system=rough), *others))
    wrong = {row.quantity for row in symmetry.run().rows if not row.agrees}
    assert wrong == {"free: momenta that stay", "free: relative change of these"}


def test_a_textbook_that_is_wrong_is_detected(monkeypatch: pytest.MonkeyPatch) -> None:
    """The chapter's table counts one symmetry on a plane."""
    cases = [replace(c, symmetries=1) if "plane" in c.name else c for c in symmetry._CASES]
    monkeypatch.setattr(symmetry, "_CASES", tuple(cases))
    wrong = {row.quantity for row in symmetry.run().rows if not row.agrees}
    assert wrong == {"on a springy, level plane: symmetries"}
