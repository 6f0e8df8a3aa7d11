"""Reports: one self-contained page of text, tables, vector figures and a replay, for all screens and for printing.

A page consists of sections, sections of blocks. Each function here returns the HTML of one, with its text escaped.
"""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib import resources

from lgmpc.viz.figure_files import Drawing, figure_heading, svg_figures
from lgmpc.viz.page import filled

__all__ = ["code", "figures", "folded", "replay", "report_page", "section", "table", "words"]


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
        "script": "".join((assets / name).read_text(encoding="utf-8") for name in ("report.js", "figures.js")),
    }
    return filled((assets / "report.html").read_text(encoding="utf-8"), parts)


def _lines(blocks: Iterable[str]) -> str:
    return "\n".join(blocks)
