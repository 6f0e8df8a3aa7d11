"""``lgmpc solve``: the table of iterations, and the result."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from itertools import count
from pathlib import Path

from rich.console import Console
from rich.text import Text

from lgmpc.cli.display import Display, Row, figure_table, progress_display, warnings_on
from lgmpc.cli.screen import err, out, print_result, show_next, show_verdict
from lgmpc.config import SolveConfig
from lgmpc.config.execution import FinishedSolve, solve_config
from lgmpc.config.session import Iteration
from lgmpc.runs import Outcome
from lgmpc.runs.figures import figure_of

__all__ = ["solve_shown"]


def solve_shown(config: SolveConfig, folder: Path, *, as_json: bool, quiet: bool) -> int:
    """Solve the problem of ``config`` with a display of iterations, print the verdict, and return the exit code."""
    console = err()
    with _display(console, config, quiet=quiet) as display, warnings_on(console):
        finished = solve_config(config, folder, notify=display.announce, progress=display.advance)
    if as_json:
        print_result(finished.folder.path, finished.result)
    else:
        _show(finished, config, quiet=quiet)
    return finished.exit_code


def _show(finished: FinishedSolve, config: SolveConfig, *, quiet: bool) -> None:
    console, outcome = out(), finished.outcome
    if not quiet:
        console.print(figure_table(_rows(outcome.figures, config.gate.bounds)))
    if outcome.explanation and not (quiet and outcome.converged) and outcome.verdict.outcome is not Outcome.INTERRUPTED:
        console.print(Text(outcome.explanation))
    show_verdict(console, outcome.verdict, finished.result.name)
    if not quiet:
        show_next(console, finished.folder.path)


def _rows(figures: Mapping[str, float], bounds: Mapping[str, float]) -> Iterator[Row]:
    """Return the rows of all figures: those with bounds first, a row for each bound."""
    for bound, limit in bounds.items():
        yield Row.of(figure_of(bound), figures[figure_of(bound)], limit, highest=bound.startswith("max_"))
    bounded = set(map(figure_of, bounds))
    for figure, value in figures.items():
        if figure not in bounded and not math.isnan(value):
            yield Row.of(figure, value)


Columns = Mapping[str, Callable[[Iteration], str]]
"""Heading of each column, and its text for an iteration."""


def _columns(method: str) -> Columns:
    """Return the columns of a method: the criterion of FDDP is the expected reduction, that of SQP the residual."""
    criterion = "reduction" if "fddp" in method else "residual"
    return {
        "iteration": lambda now: str(now.count),
        "cost": lambda now: f"{now.cost:.6g}",
        criterion: lambda now: _scientific(now.criterion),
        "gap": lambda now: _scientific(now.gap),
        "step": lambda now: "-" if math.isnan(now.step) else "rejected" if now.step == 0.0 else f"{now.step:.4g}",
        "regularis.": lambda now: _scientific(now.regularization),
        "ms": lambda now: f"{1e3 * now.elapsed_s:.0f}",
    }


def _scientific(value: float) -> str:
    return "-" if math.isnan(value) else "0" if value == 0.0 else f"{value:.1e}"


@contextmanager
def _display(console: Console, config: SolveConfig, *, quiet: bool) -> Iterator[Display[Iteration]]:
    """Print a line for each iteration, with headings in between, and on terminals a bar of the stage."""
    columns, rows = _columns(config.solver.method), count()

    def lines(now: Iteration) -> Iterator[str]:
        if next(rows) % 20 == 0:
            yield "".join(f"{name:>14}" for name in columns)
        yield "".join(f"{write(now):>14}" for write in columns.values())

    with progress_display(console, lines, lambda now: {}, quiet=quiet, above=True) as display:
        yield display
