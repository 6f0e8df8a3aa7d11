"""``lgmpc doctor``: one line per check, remedies, and an exit code."""

from collections.abc import Iterator

import pytest

from lgmpc.doctor import Check

from .conftest import Invoke


def test_this_installation_is_checked(invoke: Invoke) -> None:
    code, output = invoke("doctor")
    assert code == 0, output
    for name in (
        "python",
        "pin",
        "casadi",
        "compiler",
        "cache",
        "robot",
        "NLP by ipopt",
        "NLP by fatrop",
        "mujoco plant",
    ):
        assert any(line.startswith("ok") and f" {name} " in line for line in output.splitlines()), name
    assert "sound" in output


def test_failed_checks_are_counted_and_have_a_remedy(invoke: Invoke, monkeypatch: pytest.MonkeyPatch) -> None:
    def checks() -> Iterator[Check]:
        yield Check("casadi", False, "not installed", "pip install casadi")
        yield Check("numpy", True, "2.0")

    monkeypatch.setattr("lgmpc.doctor.iterate_checks", checks)
    monkeypatch.setattr("lgmpc.cli.inspecting.iterate_checks", checks)
    code, output = invoke("doctor")
    assert code == 1
    lines = output.splitlines()
    assert lines[0].split() == ["broken", "casadi", "not", "installed"]
    assert lines[1].split() == ["->", "pip", "install", "casadi"]
    assert "1 broken" in output and "sound" not in output
