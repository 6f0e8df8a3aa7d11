"""The report of a run or of a solved trajectory."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING

from lgmpc.errors import InputError
from lgmpc.robot import Robot
from lgmpc.runs import Gate, Run, SolvedRun, flat_metrics, measured
from lgmpc.runs.certificate import Certificate
from lgmpc.runs.events import event_lines
from lgmpc.runs.figures import figure_number, figure_of, figure_words
from lgmpc.runs.forensics import Explanation
from lgmpc.viz.explanation_plots import draw_explanation
from lgmpc.viz.figure_files import Drawing, svg_figures
from lgmpc.viz.plots import run_drawings
from lgmpc.viz.replay import replay_page
from lgmpc.viz.report import Block, Code, Figure, Folded, Replay, Report, Section, Table, Words
from lgmpc.viz.trajectory_plots import trajectory_drawings
from lgmpc.viz.trajectory_replay import trajectory_page

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

__all__ = ["run_report", "solve_report"]

_HEADINGS = ("figure", "measured", "allowed", "")


def run_report(robot: Robot, run: Run, gate: Gate, explanation: Explanation) -> Report:
    """Return the report of a closed loop: verdict, replay, figures, events, limits, certificate, config, versions.

    Args:
        robot: robot of the run.
        run: contents of the run folder.
        gate: limits of its verdict.
        explanation: explanation of the run.

    Raises:
        InputError: if the run has no finite tick.
        MissingDependencyError: if matplotlib or meshcat is not installed.
    """
    failed = explanation.failed_s is not None
    events = Section(
        "Events",
        (
            Words(tuple(_repeated(run, explanation))),
            _events(explanation),
            *_figures({"events": partial(_drawn, explanation=explanation)}),
        ),
    )
    limits = Section(f"Nearest to limits{', until the failure' if failed else ''}", (_nearest(explanation),))
    metrics = run.result.metrics
    merit: tuple[Section, ...] = ()
    if metrics is not None:
        limited = [(key, measured(metrics, key), limit) for key, limit in gate.limits.items()]
        merit = (Section("Figures of merit", (_bounded(limited), _all_figures(flat_metrics(metrics)))),)
    certificate = () if run.result.certificate is None else (_certificate(run.result.certificate),)
    shown = Section("Figures", _figures(run_drawings(run)))
    return Report(
        run.result.name,
        run.result.verdict.outcome.value,
        f"{run.result.when} · {robot.name} · seed {run.result.seed}",
        (*run.result.verdict.reasons, *explanation.summary),
        (*_replayed(partial(replay_page, robot, run)), *merit, shown, events, limits, *certificate, *_sources(run)),
    )


def solve_report(robot: Robot, run: SolvedRun, bounds: Mapping[str, float]) -> Report:
    """Return the report of a solved trajectory: verdict, replay, figures, config, versions.

    Args:
        robot: robot of the run.
        run: contents of the run folder.
        bounds: bounds of its gate by their keys.

    Raises:
        InputError: if the trajectory is not finite.
        MissingDependencyError: if matplotlib or meshcat is not installed.
    """
    result = run.result
    figures = result.figures
    limited = [(key, figures.get(figure_of(key)), limit) for key, limit in bounds.items()]
    explanation = Words([line.strip() for line in result.explanation.splitlines() if line.strip()])
    merit = Section("Figures of merit", (explanation, _bounded(limited), _all_figures(figures)))
    shown = Section("Figures", _figures(trajectory_drawings(robot, run)))
    return Report(
        result.name,
        result.verdict.outcome.value,
        f"{result.when} · {robot.name} · {result.method}: {result.status.replace('_', ' ')}",
        result.verdict.reasons,
        (*_replayed(partial(trajectory_page, robot, run)), merit, shown, *_sources(run)),
    )


def _repeated(run: Run, explanation: Explanation) -> Iterator[str]:
    """Yield the origin of a continued run, and the command that repeats the run up to its first event."""
    if run.result.origin is not None:
        yield str(run.result.origin)
    if explanation.replay_from_s is not None:
        command = f"lgmpc run --from {run.path}@{explanation.replay_from_s:g} --set KEY=VALUE"
        yield f"to repeat it up to the first event, and continue with other settings: {command}"


def _drawn(figure: Canvas, explanation: Explanation) -> bool:
    draw_explanation(figure, explanation)
    return True


def _figures(drawings: Mapping[str, Drawing]) -> tuple[Block, ...]:
    return tuple(Figure(name, svg) for name, svg in svg_figures(drawings).items())


def _events(explanation: Explanation) -> Table:
    rows = [
        (each.start_s, f"{each.start_s:.3f}", f"{1e3 * each.lasting_s:.0f}", each.kind.value, each.words)
        for each in event_lines(explanation.events)
    ]
    if explanation.failed_s is not None:
        rows.append((explanation.failed_s, f"{explanation.failed_s:.3f}", "", "failure", explanation.failure))
    rows.sort(key=lambda row: row[0])
    marks = ["bad" if row[3] == "failure" else "" for row in rows]
    return Table(("at / s", "lasts / ms", "what", ""), [row[1:] for row in rows], marks)


def _nearest(explanation: Explanation) -> Table:
    rows, marks = [], []
    for each in explanation.nearest:
        name = f"{each.name} / {each.unit}" if each.unit else each.name
        when = "" if each.time_s is None else f"{each.time_s:.3f}"
        rows.append((name, each.subject, when, *map(figure_number, (each.value, each.limit, each.margin))))
        marks.append("bad" if each.broken else "")
    return Table(("quantity", "where", "at / s", "value", "limit", "margin"), rows, marks)


def _certificate(certificate: Certificate) -> Section:
    words = "all checks of physics and hardware passed" if certificate.certified else "not certified"
    rows, marks = [], []
    for each in certificate.checks:
        figures = map(figure_number, (each.value, each.limit, each.margin))
        name = f"{each.name} / {each.unit}"
        rows.append((name, each.subject, f"{each.time_s:.3f}", *figures, "kept" if each.kept else "broken"))
        marks.append("good" if each.kept else "bad")
    headings = ("check, until a fall", "where", "at / s", "value", "limit", "smallest margin", "")
    peaks = [f"without a limit in the config: {each}" for each in certificate.peaks]
    return Section("Certificate", (Words([words]), Table(headings, rows, marks), Words(peaks)))


def _bounded(limited: list[tuple[str, float | None, float]]) -> Table:
    """Return the figures that the gate limits, with their limits."""
    rows, marks = [], []
    for key, value, limit in limited:
        words, unit, scale = figure_words(figure_of(key))
        highest = key.startswith("max_")
        kept = value is not None and (value <= limit if highest else value >= limit)
        shown = "-" if value is None else figure_number(scale * value, unit, scale * limit)
        name = f"{words} / {unit}" if unit else words
        rows.append((name, shown, f"{'≤' if highest else '≥'} {scale * limit:g}", "kept" if kept else "broken"))
        marks.append("good" if kept else "bad")
    return Table(_HEADINGS, rows, marks)


def _all_figures(figures: Mapping[str, float | None]) -> Folded:
    rows = []
    for key, value in figures.items():
        group, _, name = key.rpartition(".")
        words, unit, scale = figure_words(name)
        shown = "-" if value is None else figure_number(scale * value, unit)
        rows.append((f"{group} {words}".strip(), shown, unit))
    return Folded("All figures", (Table(("figure", "measured", "unit"), rows),))


def _replayed(page: partial[str]) -> tuple[Section, ...]:
    """Return the section of the replay; none if the run cannot be replayed."""
    try:
        return (Section("Replay", (Replay(page()),)),)
    except InputError:
        return ()


def _sources(run: Run | SolvedRun) -> Iterator[Section]:
    yield Section("Config", (Folded("config.yaml, defaults included", (Code(run.config.rstrip()),)),))
    result = run.result
    rows = [*result.versions.items(), *((key, str(value)) for key, value in asdict(result.host).items())]
    yield Section("Versions and machine", (Folded("Packages, processor", (Table(("", ""), rows),)),))
