"""Messages and exit codes of exceptions."""

from pathlib import Path

import pytest
import typer

from lgmpc.cli.screen import guarded
from lgmpc.errors import ConfigError, LgmpcError, ModelError, SolverError


def code_of(error: BaseException) -> int:
    @guarded
    def command() -> None:
        raise error

    with pytest.raises(typer.Exit) as caught:
        command()
    return caught.value.exit_code


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (ConfigError("f.yaml:3", "a.b", 1, "2"), 2, "error: f.yaml:3: a.b: got 1; expected 2"),
        (ModelError("arm", ["no mass", "no feet"]), 2, "error: robot 'arm' cannot be used:\n  - no mass\n  - no feet"),
        (SolverError("nlp", "failed", "Relax it."), 1, "error: nlp: failed. Relax it."),
        (LgmpcError("[bold]as it is[/bold]"), 2, "error: [bold]as it is[/bold]"),
        (KeyboardInterrupt(), 130, "stopped; nothing was saved"),
    ],
)
def test_an_lgmpc_error_is_printed_without_traceback(
    error: BaseException, code: int, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert code_of(error) == code
    captured = capsys.readouterr()
    assert words in captured.err
    assert captured.out == ""


def test_an_import_error_by_ctrl_c_is_no_crash(capsys: pytest.CaptureFixture[str]) -> None:
    disguised = ImportError("initialization failed")
    disguised.__cause__ = KeyboardInterrupt()
    assert code_of(disguised) == 130
    assert "stopped; nothing was saved" in capsys.readouterr().err


def test_an_unforeseen_exception_saves_its_traceback(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.setenv("HOME", str(tmp_path))
    assert code_of(ZeroDivisionError("one\nover zero")) == 70
    shown = capsys.readouterr().err
    (report,) = tmp_path.rglob("crash-*.txt")
    assert "internal error: ZeroDivisionError: one over zero" in shown
    assert "Traceback" not in shown
    assert str(report) in shown
    text = report.read_text(encoding="utf-8")
    assert "Traceback (most recent call last)" in text and "in command" in text


def test_where_logs_cannot_be_written_the_traceback_goes_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    blocked, open_ = tmp_path / "blocked", tmp_path / "open"
    blocked.write_text("", encoding="utf-8")
    open_.mkdir()
    monkeypatch.setenv("XDG_STATE_HOME", str(blocked))
    monkeypatch.setenv("HOME", str(blocked))
    monkeypatch.setattr("tempfile.tempdir", str(open_))
    assert code_of(RuntimeError("x")) == 70
    (report,) = open_.iterdir()
    assert str(report) in capsys.readouterr().err


def test_a_system_exit_keeps_its_code() -> None:
    assert code_of(typer.Exit(5)) == 5
