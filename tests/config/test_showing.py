"""Replay and figures of a run, from what running it returned or from its folder."""

from pathlib import Path

import pytest

from lgmpc import load_config, load_solve_config, plot, run_config, show, solve_config
from lgmpc.errors import RunFolderError


def test_a_finished_run_and_its_folder_give_the_same_page(tmp_path: Path) -> None:
    run = run_config(load_config("solo12_stand", ["duration_s=0.1"]), tmp_path)
    page = show(run, tmp_path / "run.html")
    again = show(str(run.folder.path), str(tmp_path / "folder.html"))
    assert page is not None and again is not None
    assert page == tmp_path / "run.html"
    assert page.read_text(encoding="utf-8") == again.read_text(encoding="utf-8")
    assert page.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    figures = plot(run)
    assert figures and {figure.parent for figure in figures} == {run.folder.path / "figures"}
    assert [figure.name for figure in plot(run.folder.path, tmp_path / "drawn")] == [figure.name for figure in figures]


def test_a_solved_problem_is_shown_too(tmp_path: Path) -> None:
    solved = solve_config(load_solve_config("panda_reach"), tmp_path)
    page = show(solved, tmp_path / "reach.html")
    assert page is not None and "panda" in page.read_text(encoding="utf-8")
    assert all(figure.is_file() for figure in plot(solved))


def test_a_folder_that_is_no_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RunFolderError):
        show(tmp_path, tmp_path / "page.html")
    assert list(tmp_path.iterdir()) == []
