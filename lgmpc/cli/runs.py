"""Which run the user means."""

from __future__ import annotations

from pathlib import Path

from lgmpc.errors import RunFolderError, nearest

__all__ = ["find_run", "run_names"]


def find_run(text: str, runs: Path) -> Path:
    """Return the run folder that ``text`` names.

    Args:
        text: a path, the name of a folder in ``runs``, or ``latest``.
        runs: folder of run folders.

    Raises:
        RunFolderError: if there is none; names what is there.
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
