"""``lgmpc solve``: the table of iterations, and the result."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console, Group
from rich.live import Live
from rich.spinner import Spinner
from rich.table import Table
from rich.text import Text

from lgmpc.cli.display import Display, Row, Silent, figure_table, warnings_on
from lgmpc.cli.screen import err, out, print_result, show_next, show_verdict
from lgmpc.config import SolveConfig
from lgmpc.config.execution import FinishedSolve, solve_config
from lgmpc.config.session import Iteration
from lgmpc.runs import Outcome
from lgmpc.runs.figures import figure_of

__all__ = ["solve_shown"]

_ROWS = 12
"""Number of iterations in the moving table, the last ones."""


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


class _Lines:
    """Display for pipes and files: a line for each stage and iteration."""

    def __init__(self, console: Console, columns: Columns) -> None:
        self._console = console
        self._columns = columns
        self._count = 0

    def announce(self, message: str) -> None:
        self._console.print(message, markup=False)

    def advance(self, now: Iteration) -> None:
        if self._count % 20 == 0:
            self._console.print("".join(f"{name:>14}" for name in self._columns), markup=False)
        self._count += 1
        self._console.print("".join(f"{write(now):>14}" for write in self._columns.values()), markup=False)


class _Moving:
    """Display for terminals: a table of the last iterations, updated in place."""

    def __init__(self, live: Live, columns: Columns) -> None:
        self._live = live
        self._columns = columns
        self._rows: deque[Iteration] = deque(maxlen=_ROWS)
        self._spinner = Spinner("dots", "")

    def announce(self, message: str) -> None:
        self._spinner.update(text=Text(message))
        self._draw()

    def advance(self, now: Iteration) -> None:
        self._rows.append(now)
        self._draw()

    def _draw(self) -> None:
        table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim")
        for name in self._columns:
            table.add_column(name, justify="right")
        for row in self._rows:
            table.add_row(*(write(row) for write in self._columns.values()))
        self._live.update(Group(*((table,) if self._rows else ()), self._spinner))


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
    columns = _columns(config.solver.method)
    if quiet:
        yield Silent()
    elif not console.is_terminal:
        yield _Lines(console, columns)
    else:
        with Live(console=console, transient=True, refresh_per_second=12) as live:
            yield _Moving(live, columns)
