"""Saved runs: lookup by path, name or ``latest``; ``lgmpc play``, ``lgmpc plot`` and ``lgmpc report``."""

from __future__ import annotations

from pathlib import Path

from lgmpc.errors import RunFolderError, nearest

__all__ = ["find_run", "play_folder", "plot_folder", "report_folder", "run_names"]


def find_run(text: str, runs: Path) -> Path:
    """Return the run folder named by ``text``.

    Args:
        text: a path, the name of a folder in ``runs``, or ``latest``.
        runs: folder of run folders.

    Raises:
        RunFolderError: if there is none; names the nearest.
    """
    if text != "latest":
        for path in (Path(text), runs / text):
            if path.is_dir():
                return path
        near = nearest(text, run_names(runs))
        hint = f" Did you mean {' or '.join(near)}?" if near else ""
        raise RunFolderError(f"no run folder {text}, neither here nor in {runs}/.{hint}")
    complete = [runs / name for name in run_names(runs)]
    if not complete:
        raise RunFolderError(f"no finished run in {runs}/ yet. Make one: lgmpc run solo12_balance")
    return max(complete, key=lambda path: ((path / "run.json").stat().st_mtime_ns, path.name))


def run_names(runs: Path) -> list[str]:
    """Return the names of the finished runs in ``runs``, in alphabetical order; none if there is no such folder."""
    if not runs.is_dir():
        return []
    return sorted(path.name for path in runs.iterdir() if (path / "run.json").is_file())


def play_folder(folder: Path, html: Path | None, port: int) -> None:
    """Serve the replay of a run until Ctrl-C, or write it to ``html``."""
    from lgmpc.cli.screen import out
    from lgmpc.config.showing import show

    file = show(folder, html, port=port)
    if file is not None:
        out().print(_page(file), markup=False)


def plot_folder(folder: Path, into: Path | None) -> None:
    """Draw the figures of a run."""
    from lgmpc.cli.screen import out
    from lgmpc.config.showing import plot

    for figure in plot(folder).save(into or folder / "figures"):
        out().print(f"wrote {figure}", markup=False)


def report_folder(text: str, runs: Path, html: Path | None) -> None:
    """Write the report of what ``text`` names: a sweep's folder, a run folder, a run's name or ``latest``."""
    from lgmpc.cli.screen import out
    from lgmpc.config.showing import report
    from lgmpc.sweeps.comparison import is_sweep
    from lgmpc.sweeps.report import write_sweep_report

    folder = Path(text)
    file = write_sweep_report(folder, html) if is_sweep(folder) else report(find_run(text, runs), html)
    out().print(_page(file), markup=False)


def _page(file: Path) -> str:
    return f"wrote {file} ({file.stat().st_size / 1e6:.1f} MB): open it in any browser"
