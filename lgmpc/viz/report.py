"""Reports: one self-contained page of text, tables, vector figures and a replay, for all screens and for printing.

A page consists of sections, sections of blocks. Each function here returns the HTML of one, with its text escaped.
"""

import base64
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from html import escape
from importlib import resources

from lgmpc.errors import InputError
from lgmpc.robot import Robot
from lgmpc.runs import Run, SolvedRun
from lgmpc.runs.certificate import Certificate
from lgmpc.runs.forensics import Explanation
from lgmpc.runs.tables import events_table, figures_table, limits_table, margins_table
from lgmpc.viz.figure_files import Drawing, figure_heading, svg_figures
from lgmpc.viz.page import filled
from lgmpc.viz.plots import run_drawings
from lgmpc.viz.replay import replay_page
from lgmpc.world import World


def words(sentences: Iterable[str]) -> str:
    """Return a list of sentences; nothing for none."""
    items = "".join(f"<li>{escape(each)}</li>" for each in sentences)
    return f"<ul>{items}</ul>" if items else ""


def table(headings: Sequence[str], rows: Sequence[Sequence[str]], marks: Sequence[str] = ()) -> str:
    """Return a table of text.

    Args:
        headings: of the columns.
        rows: cells as text.
        marks: for rows, "good" or "bad" where they are marked; empty for none.
    """
    head = "".join(f"<th>{escape(each)}</th>" for each in headings)
    body = []
    for row, mark in zip(rows, marks or [""] * len(rows), strict=True):
        cells = "".join(f"<td>{escape(each)}</td>" for each in row)
        body.append((f'<tr class="{escape(mark)}">' if mark else "<tr>") + f"{cells}</tr>")
    return f'<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>{"".join(body)}</tbody></table></div>'


def figures(drawings: Mapping[str, Drawing]) -> str:
    """Return vector figures, those that have data.

    Raises:
        MissingDependencyError: if matplotlib is not installed.
    """
    found = []
    for name, svg in svg_figures(drawings).items():
        caption = f"<figcaption>{escape(figure_heading(name))}</figcaption>"
        found.append(f'<figure role="img" aria-label="{escape(name)}">{caption}{svg}</figure>')
    return "\n".join(found)


def code(text: str) -> str:
    """Return text in a font of fixed width."""
    return f"<pre>{escape(text)}</pre>"


def replay(page: str) -> str:
    """Return a replay page that is loaded on demand."""
    data = base64.b64encode(page.encode("utf-8")).decode("ascii")
    button = '<button type="button">Load the replay</button>'
    return f'<div class="replay">{button}<script type="application/octet-stream">{data}</script></div>'


def folded(title: str, *blocks: str) -> str:
    """Return blocks that are shown on demand, and always printed."""
    return f"<details><summary>{escape(title)}</summary>{_lines(blocks)}</details>"


def section(title: str, *blocks: str) -> str:
    """Return a part of a report."""
    return f"<section><h2>{escape(title)}</h2>\n{_lines(blocks)}\n</section>"


def report_page(title: str, verdict: str, about: str, reasons: Iterable[str], sections: Iterable[str]) -> str:
    """Return the page's HTML, which is self-contained.

    Args:
        title: name of the run or sweep.
        verdict: "pass", "fail" or "interrupted".
        about: line with time of creation, robot and seed.
        reasons: reasons for the verdict.
        sections: sections in order.
    """
    assets = resources.files("lgmpc.viz") / "assets"
    head = (
        f'<header><h1>{escape(title)}</h1><span class="verdict {escape(verdict)}">{escape(verdict)}</span>'
        f"<p>{escape(about)}</p>{words(reasons)}</header>"
    )
    parts = {
        "title": escape(f"{title} · lgmpc report"),
        "style": (assets / "report.css").read_text(encoding="utf-8"),
        "body": _lines([head, *sections]),
        "script": (assets / "report.js").read_text(encoding="utf-8"),
    }
    return filled((assets / "report.html").read_text(encoding="utf-8"), parts)


def _lines(blocks: Iterable[str]) -> str:
    return "\n".join(blocks)


def run_report(
    robot: Robot,
    run: Run | SolvedRun,
    limits: Mapping[str, float],
    explanation: Explanation,
    ground: World | None = None,
) -> str:
    """Return the page of a run: verdict, replay, figures, events, limits, certificate, config, versions.

    Args:
        robot: robot of the run.
        run: contents of the run folder.
        limits: limits of its gate by their keys.
        explanation: explanation of the run.
        ground: of the run's world; the level floor at height 0 unless given.

    Raises:
        InputError: if the run has no finite tick, or the trajectory is not finite.
        MissingDependencyError: if matplotlib or meshcat is not installed.
    """
    result = run.result

    def sections() -> Iterator[str]:
        yield from _replayed(partial(replay_page, robot, run, ground))
        if result.figures:
            everything = folded("All figures", table(*figures_table(result.figures)))
            yield section("Figures of merit", table(*limits_table(result.limited(limits))), everything)
        yield section("Figures", figures(run_drawings(robot, run)))
        if isinstance(run, Run):
            events = table(*events_table(explanation.events, explanation.failed_s, explanation.failure))
            again = (
                f"to repeat it up to the first event, with other settings from then on: {explanation.command(run.path)}"
            )
            yield section("Events", words([again] if explanation.events else []), events)
        until = "" if explanation.failed_s is None else ", until the failure"
        yield section(f"Nearest to limits{until}", table(*margins_table(explanation.nearest)))
        if isinstance(run, Run) and run.result.certificate is not None:
            yield _certificate(run.result.certificate)
        yield section("Config", folded("config.yaml, defaults included", code(run.config.rstrip())))
        rows = [*result.versions.items(), *((key, str(value)) for key, value in asdict(result.host).items())]
        yield section("Versions and machine", folded("Packages, processor", table(("", ""), rows)))

    about = f"{result.when} · {robot.name} · {result.about}"
    reasons = dict.fromkeys((*result.verdict.reasons, *explanation.summary))  # a summary may be the reason
    return report_page(result.name, result.verdict.outcome.value, about, reasons, sections())


def _certificate(certificate: Certificate) -> str:
    marks = ["good" if each.kept else "bad" for each in certificate.checks]
    checks = margins_table(certificate.checks, "check, until a fall")._replace(marks=marks)
    found = "all checks of physics and hardware passed" if certificate.certified else "not certified"
    return section("Certificate", words([found]), table(*checks))


def _replayed(page: Callable[[], str]) -> Iterator[str]:
    """Yield the section of the replay; none if the run cannot be replayed."""
    try:
        yield section("Replay", replay(page()))
    except InputError:
        return
