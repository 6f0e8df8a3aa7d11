"""Texts of the command line's help, of which a paragraph is one line: the terminal breaks it."""

from importlib.resources import files

_FOLDER = files("lgmpc.cli")
OVERVIEW = _FOLDER.joinpath("overview.txt").read_text("utf-8")


def examples(command: str) -> str:
    """Return the text after the options of a command: one paragraph for each line, so that none are joined."""
    texts = _FOLDER.joinpath("examples.txt").read_text("utf-8").split("\n\n")  # one for each command, its name first
    paragraphs = {name: lines for name, *lines in map(str.splitlines, texts)}
    return "\n\n".join(["[bold]Examples[/bold]", *(f"  {line}" for line in paragraphs[command])])
