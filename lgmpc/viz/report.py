"""Reports: one self-contained page of text, tables, vector figures and a replay, for all screens and for printing."""

from __future__ import annotations

import base64
import html
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources

from lgmpc.viz.page import filled

__all__ = ["Block", "Code", "Figure", "Folded", "Replay", "Report", "Section", "Table", "Words", "report_page"]


@dataclass(frozen=True)
class Words:
    """A list of sentences."""

    sentences: Sequence[str]


@dataclass(frozen=True)
class Table:
    """A table of text.

    Attributes:
        headings: of the columns.
        rows: cells as text.
        marks: for rows, "good" or "bad" where they are marked; empty for none.
    """

    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    marks: Sequence[str] = ()


@dataclass(frozen=True)
class Figure:
    """A vector figure.

    Attributes:
        name: of the figure, for screen readers.
        svg: its text, see :func:`lgmpc.viz.figure_files.svg_figures`.
    """

    name: str
    svg: str


@dataclass(frozen=True)
class Code:
    """Text in a font of fixed width."""

    text: str


@dataclass(frozen=True)
class Replay:
    """A replay page, loaded on demand."""

    page: str


@dataclass(frozen=True)
class Folded:
    """Blocks that are shown on demand, and always printed.

    Attributes:
        title: their title.
        blocks: the blocks.
    """

    title: str
    blocks: Sequence[Block]


Block = Words | Table | Figure | Code | Replay | Folded


@dataclass(frozen=True)
class Section:
    """A part of a report."""

    title: str
    blocks: Sequence[Block]


@dataclass(frozen=True)
class Report:
    """The content of a report.

    Attributes:
        title: name of the run or sweep.
        verdict: "pass", "fail" or "interrupted".
        about: line with time of creation, robot and seed.
        reasons: reasons for the verdict.
        sections: sections in order.
    """

    title: str
    verdict: str
    about: str
    reasons: Sequence[str]
    sections: Sequence[Section]


def report_page(report: Report) -> str:
    """Return the page's HTML, which is self-contained."""
    assets = resources.files("lgmpc.viz") / "assets"
    parts = {
        "title": html.escape(f"{report.title} · lgmpc report"),
        "style": (assets / "report.css").read_text(encoding="utf-8"),
        "body": "\n".join([_head(report), *(_section(each) for each in report.sections)]),
        "script": "".join((assets / name).read_text(encoding="utf-8") for name in ("report.js", "figures.js")),
    }
    return filled((assets / "report.html").read_text(encoding="utf-8"), parts)


def _head(report: Report) -> str:
    verdict = html.escape(report.verdict)
    return (
        f'<header><h1>{html.escape(report.title)}</h1><span class="verdict {verdict}">{verdict}</span>'
        f"<p>{html.escape(report.about)}</p>{_block(Words(report.reasons))}</header>"
    )


def _section(section: Section) -> str:
    blocks = "\n".join(_block(each) for each in section.blocks)
    return f"<section><h2>{html.escape(section.title)}</h2>\n{blocks}\n</section>"


def _block(block: Block) -> str:
    if isinstance(block, Words):
        items = "".join(f"<li>{html.escape(each)}</li>" for each in block.sentences)
        return f"<ul>{items}</ul>" if items else ""
    if isinstance(block, Table):
        return _table(block)
    if isinstance(block, Figure):
        return f'<figure role="img" aria-label="{html.escape(block.name)}">{block.svg}</figure>'
    if isinstance(block, Code):
        return f"<pre>{html.escape(block.text)}</pre>"
    if isinstance(block, Replay):
        page = base64.b64encode(block.page.encode("utf-8")).decode("ascii")
        return (
            '<div class="replay"><button type="button">Load the replay</button>'
            f'<script type="application/octet-stream">{page}</script></div>'
        )
    inside = "\n".join(_block(each) for each in block.blocks)
    return f"<details><summary>{html.escape(block.title)}</summary>{inside}</details>"


def _table(table: Table) -> str:
    head = "".join(f"<th>{html.escape(each)}</th>" for each in table.headings)
    rows = []
    for i, row in enumerate(table.rows):
        mark = f' class="{html.escape(table.marks[i])}"' if i < len(table.marks) and table.marks[i] else ""
        rows.append(f"<tr{mark}>" + "".join(f"<td>{html.escape(each)}</td>" for each in row) + "</tr>")
    return f'<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>{"".join(rows)}</tbody></table></div>'
