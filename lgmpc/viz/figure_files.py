"""What figures of all kinds of runs share: their files, titles, legends and limits."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from lgmpc.errors import RunFolderError
from lgmpc.runs import RunResult, SolveResult, atomic_write
from lgmpc.runs.atomic import reason_of
from lgmpc.viz.style import LIMIT, SOFT, figure_maker

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_limits", "figure_title", "joint_kinds", "legend_above", "write_figures"]


def write_figures(drawings: Mapping[str, Callable[[Figure], bool]], title: str, folder: Path) -> tuple[Path, ...]:
    """Draw figures into PNG files.

    Args:
        drawings: file name without ``.png`` -> drawing, which returns whether there was data.
        title: above each.
        folder: where the files go; made if it does not exist.

    Returns:
        Paths of the files.

    Raises:
        RunFolderError: if the folder cannot be written.
        MissingDependencyError: if matplotlib is not installed.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunFolderError(f"cannot make {folder}: {reason_of(error)}") from error
    written = []
    with figure_maker("lgmpc plot") as make:
        for name, draw in drawings.items():
            figure = make()
            if not draw(figure):
                continue
            figure.suptitle(title, x=0.01, ha="left", fontsize=9, color=SOFT)
            path = folder / f"{name}.png"
            with atomic_write(path) as file:
                figure.savefig(file, format="png")
            written.append(path)
    return tuple(written)


def figure_title(result: RunResult | SolveResult) -> str:
    """Return name, verdict and time of a run."""
    return f"{result.name} · {result.verdict.outcome.value} · {result.when}"


def joint_kinds(names: Sequence[str]) -> dict[str, list[int]]:
    """Return the joints of each kind that the legs share (``FL_HFE``: kind ``HFE``); none if none are."""
    kinds: dict[str, list[int]] = {}
    for joint, name in enumerate(names):
        kinds.setdefault(name.partition("_")[2], []).append(joint)
    alike = len(kinds) <= 4 and "" not in kinds and all(2 <= len(joints) <= 4 for joints in kinds.values())
    return kinds if alike else {}


def legend_above(*all_axes: Axes) -> None:
    """Put the legend of each axes above its right end."""
    for axes in all_axes:
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, borderaxespad=0.1, handlelength=1.4)


def draw_limits(axes: Axes, low: float, high: float, text: str) -> None:
    """Draw lines at two limits, and write below the upper one what they are."""
    for value in (low, high):
        axes.axhline(value, color=LIMIT, ls="--", lw=1.1)
    axes.annotate(
        text,
        (0.995, high),
        (0, -3),
        xycoords=("axes fraction", "data"),
        textcoords="offset points",
        color=LIMIT,
        ha="right",
        va="top",
        fontsize=8.5,
    )
