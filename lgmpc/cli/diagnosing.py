"""``lgmpc doctor``: one line per check."""

from __future__ import annotations

from rich.text import Text

from lgmpc.cli.screen import err, out
from lgmpc.doctor import iterate_checks

__all__ = ["show_diagnosis"]

_WIDTH = 28


def show_diagnosis() -> int:
    """Print the result of each check, and return 0 if all passed, else 1."""
    console = out()
    failed = 0
    with err().status("checking"):
        for check in iterate_checks():
            failed += not check.ok
            mark = ("ok    ", "green") if check.ok else ("broken", "bold red")
            console.print(Text.assemble(mark, f"  {check.name:<{_WIDTH}}{check.detail}"))
            if check.remedy:
                console.print(Text(f"{'':8}{'':{_WIDTH}}-> {check.remedy}", "yellow"))
    if failed:
        console.print(Text.assemble((f"{failed} broken", "bold red"), ": remedies are in the lines that begin with ->"))
        return 1
    console.print(Text("sound", "bold green"))
    return 0
