"""``lgmpc configs`` and ``lgmpc schema``: the shipped configs, copies of them to edit, and the schema for editors."""

from __future__ import annotations

import shlex
from pathlib import Path

from rich.text import Text

from lgmpc.cli.screen import out
from lgmpc.errors import InputError
from lgmpc.runs.atomic import atomic_write
from lgmpc.shipped import shipped_config, shipped_configs, shipped_sweeps

__all__ = ["copy_config", "list_configs", "print_schema"]


def list_configs() -> None:
    """Print name, command and summary of each shipped config, and of each sweep."""
    console = out()
    for configs in (shipped_configs(), shipped_sweeps()):
        width = max(map(len, configs), default=0)
        for name, config in configs.items():
            console.print(Text.assemble((f"{name:{width}}", "bold"), f"  {config.command:5}  {config.summary}"))
        console.print()
    console.print("next: lgmpc run, solve or sweep NAME; lgmpc configs --copy NAME writes one to edit", style="dim")


def copy_config(name: str, destination: Path | None, *, force: bool) -> None:
    """Write a copy of a shipped config to a file.

    Args:
        name: of the config.
        destination: file, or folder for a file of the config's name; the working directory unless given.
        force: whether to replace an existing file.

    Raises:
        ConfigError: if no shipped config has this name.
        InputError: if the file exists and ``force`` is false, or its folder does not exist.
        RunFolderError: if the file cannot be written.
    """
    config = shipped_config(name)
    file = destination or Path()
    if file.is_dir():
        file /= config.file.name
    if not file.parent.is_dir():
        raise InputError("DEST", file, "a file in a folder that exists")
    if file.exists() and not force:
        raise InputError("DEST", file, "a file that does not exist (--force replaces it)")
    with atomic_write(file) as stream:
        stream.write(config.copy_text().encode("utf-8"))
    out().print(Text(f"wrote {file}"))
    out().print(Text(f"next: lgmpc {config.command} {shlex.quote(str(file))}"), style="dim")


def print_schema(file: Path | None) -> None:
    """Write the JSON schema of configs to a file, or to stdout.

    Raises:
        InputError: if the file cannot be written.
    """
    from lgmpc.config.schema import json_schema_text

    text = json_schema_text()
    if file is None:
        print(text, end="")
        return
    try:
        file.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError("--out", file, f"a file that can be written ({error.strerror})") from error
