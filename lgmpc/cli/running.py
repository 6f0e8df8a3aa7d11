"""``lgmpc run``: progress over simulated time, and the result; of a config, or from a tick of a recorded run."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.text import Text

from lgmpc.cli.display import Display, Row, figure_table, progress_display, warnings_on
from lgmpc.cli.screen import err, out, print_result, show_next, show_verdict
from lgmpc.config import load_config
from lgmpc.config.continuing import run_from
from lgmpc.config.execution import FinishedRun, run_config
from lgmpc.config.session import Progress
from lgmpc.errors import InputError
from lgmpc.runs import Gate, Metrics, Outcome, find_run, measured
from lgmpc.runs.certificate import Certificate
from lgmpc.runs.figures import figure_of

__all__ = ["run_display", "run_shown", "show_run"]


def run_shown(first: str, origin: str, changes: Sequence[str], folder: Path, *, as_json: bool, quiet: bool) -> int:
    """Run a config, or from a tick of a recorded run, with a progress display; return the exit code.

    Args:
        first: the config; with an origin, whose config is used, the first change or nothing.
        origin: ``RUN`` or ``RUN@TIME``; empty to run a config from its start.
        changes: ``key=value``.
        folder: of run folders.
        as_json: print ``run.json``.
        quiet: print the verdict only.
    """
    begin = _continuation(first, origin, changes, folder) if origin else _beginning(first, changes, folder)
    console = err()
    with run_display(console, quiet=quiet) as display, warnings_on(console):
        finished = begin(notify=display.announce, progress=display.advance)
    if as_json:
        print_result(finished.folder.path, finished.result)
    else:
        show_run(finished, quiet=quiet)
    return finished.exit_code


def _beginning(config: str, changes: Sequence[str], folder: Path) -> Callable[..., FinishedRun]:
    if not config:
        raise InputError("CONFIG", "nothing", "a config to simulate, or --from RUN@TIME")
    return partial(run_config, load_config(config, changes), folder)


def _continuation(first: str, origin: str, changes: Sequence[str], folder: Path) -> Callable[..., FinishedRun]:
    if first and "=" not in first:
        raise InputError("CONFIG", first, "none with --from: the config is the recorded run's, changed by --set")
    name, at, time = origin.rpartition("@")
    try:
        time_s = float(time) if at else None
    except ValueError:
        raise InputError("--from", origin, "RUN, or RUN@TIME with a time in s, such as latest@2.31") from None
    path = find_run(name if at else origin, folder)
    return partial(run_from, path, time_s, [*([first] if first else []), *changes], folder)


def show_run(run: FinishedRun, *, quiet: bool) -> None:
    """Print the figures, the verdict, and the commands for the saved run."""
    console, metrics, gate = out(), run.session.metrics, run.config.gate
    if metrics is not None and not quiet:
        console.print(figure_table([*_limited(metrics, gate), *_always_shown(metrics)]))
    show_verdict(console, run.session.verdict, run.result.name)
    if not quiet:
        if run.result.origin is not None:
            console.print(Text(str(run.result.origin), "dim"))
        if run.session.certificate is not None:
            console.print(_certified(run.session.certificate))
            if run.session.certificate.peaks:
                peaks = "; ".join(map(str, run.session.certificate.peaks))
                console.print(Text(f"without a limit: {peaks}", "dim"))
        failed = run.session.verdict.outcome is Outcome.FAIL
        show_next(console, run.folder.path, *((("explain", "the events that led to the failure"),) if failed else ()))


def _certified(certificate: Certificate) -> Text:
    """Return the checks of a certificate as text: all names, or those that failed."""
    names = ", ".join(check.name for check in certificate.checks)
    if certificate.certified:
        return Text(f"certified: {names}", "dim")
    return Text(f"not certified: {'; '.join(map(str, certificate.broken))}", "yellow")


def _limited(metrics: Metrics, gate: Gate) -> Iterator[Row]:
    for name, limit in gate.limits.items():
        yield Row.of(figure_of(name), measured(metrics, name), limit, highest=name.startswith("max_"))


def _always_shown(metrics: Metrics) -> Iterator[Row]:
    estimator = metrics.estimator
    rows = (
        Row("survived", "s", metrics.survived_s),
        Row("MPC update p50", "ms", metrics.mpc_ms.p50 if metrics.mpc_ms else None),
        Row("whole-body tick p50", "ms", metrics.wbc_ms.p50 if metrics.wbc_ms else None),
        Row("estimator tick p50", "ms", metrics.estimator_ms.p50 if metrics.estimator_ms else None),
        Row("step forecasts p50", "ms", metrics.forecast_ms.p50 if metrics.forecast_ms else None),
        Row("estimated position off by", "mm", 1e3 * estimator.max_position_m if estimator else None),
        Row("estimated tilt off by", "deg", estimator.max_tilt_deg if estimator else None),
        Row("estimated yaw off by", "deg", estimator.max_yaw_deg if estimator else None),
        Row("real-time factor", "", metrics.real_time_factor),
    )
    return (row for row in rows if row.value is not None)


@contextmanager
def run_display(console: Console, *, quiet: bool) -> Iterator[Display[Progress]]:
    """Show the progress of a run on ``console``: a bar on a terminal, a line per stage elsewhere."""
    begun: list[Progress] = []

    def lines(now: Progress) -> Iterator[str]:
        if not begun:
            begun.append(now)
            yield f"simulating {now.duration_s:g} s"

    def bar(now: Progress) -> Mapping[str, Any]:
        simulated = f"{now.time_s:.1f} / {now.duration_s:g} s"
        state = f"{simulated}  tilt {now.tilt_deg:.2f} deg  {now.real_time_factor:.1f} x real time"
        return {"description": "simulating", "completed": now.time_s, "total": now.duration_s, "state": state}

    with progress_display(console, lines, bar, quiet=quiet) as display:
        yield display
