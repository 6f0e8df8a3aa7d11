"""``lgmpc demo``: the list of demonstrations; computation, table, files and viewer of one."""

import json
from dataclasses import asdict
from pathlib import Path

from rich.text import Text

from lgmpc.cli.screen import err, out, show_table
from lgmpc.demos import SUMMARIES, load_demo
from lgmpc.demos.outcome import Demo, Outcome, Row
from lgmpc.errors import InputError
from lgmpc.runs import atomic_write
from lgmpc.runs.atomic import json_values, reason_of
from lgmpc.runs.tables import Table


def list_demos() -> None:
    """Print name and summary of each demonstration."""
    show_table(Table(("", ""), list(SUMMARIES.items())))
    out().print("next: lgmpc demo NAME", style="dim")


def show_demo(name: str, folder: Path, *, view: bool, as_json: bool) -> int:
    """Run a demonstration, print its table, write its files, open its scene, and return the exit code.

    Args:
        name: of the demonstration.
        folder: of its files.
        view: open the scene in a browser, if it has one and there is a desktop.
        as_json: print the table as JSON.
    """
    from lgmpc.viz import demo_page, draw_demo, open_page, write_page

    demo = load_demo(name)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError("--out", folder, f"a folder that can be created ({reason_of(error)})") from error
    console = err()
    with console.status(f"{demo.name}: {demo.summary}"):
        outcome = demo.run()
    written = [folder / f"{name}.json"]
    with atomic_write(written[0]) as stream:
        stream.write(_json(demo, outcome).encode("utf-8"))
    if outcome.panels:
        written.append(draw_demo(demo, outcome, folder / f"{name}.png"))
    page = demo_page(demo, outcome) if outcome.bodies else ""
    if page:
        written.append(write_page(page, folder / f"{name}.html"))
    if as_json:
        print(_json(demo, outcome), end="")
    else:
        _print_table(demo, outcome, written)
    if view and page and not as_json:
        open_page(written[-1])
    return 0 if outcome.agrees else 1


def _print_table(demo: Demo, outcome: Outcome, written: list[Path]) -> None:
    console = out()
    rows = [_cells(row) for row in outcome.rows]
    marks = ["good" if row.agrees else "bad" for row in outcome.rows]
    show_table(Table(("quantity", "predicted", "measured", "off by", "allowed", ""), rows, marks))
    for remark in outcome.remarks:
        console.print(Text(remark))
    verdict = Text("AGREES", "bold green") if outcome.agrees else Text("DIFFERS", "bold red")
    console.print(Text.assemble(verdict, f"  {demo.name}: {demo.summary}"))
    for path in written:
        console.print(Text(f"wrote {path}"), style="dim")


def _cells(row: Row) -> tuple[str, ...]:
    name = f"{row.quantity}, {row.unit}" if row.unit else row.quantity
    numbers = (
        f"{row.predicted:.7g}",
        f"{row.measured:.7g}",
        f"{row.measured - row.predicted:.1e}",
        f"{row.tolerance:.0e}",
    )
    return name, *numbers, "ok" if row.agrees else "differs"


def _json(demo: Demo, outcome: Outcome) -> str:
    content = {
        "demo": demo.name,
        "agrees": outcome.agrees,
        "rows": [{**asdict(row), "agrees": row.agrees} for row in outcome.rows],
        "remarks": list(outcome.remarks),
    }
    return json.dumps(json_values(content), indent=2, allow_nan=False) + "\n"
