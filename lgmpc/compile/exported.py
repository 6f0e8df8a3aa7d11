"""Folders with a C library, its build file, recorded calls, and a program that makes these again and compares."""

from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path

from lgmpc.compile.compiler import FLAGS
from lgmpc.typing import Array


def write_exported(
    folder: Path, name: str, sources: Mapping[str, str], replayed: Mapping[str, str], records: Array
) -> None:
    """Write the folder of a library.

    Args:
        folder: an existing one.
        name: of the library; that of its header.
        sources: C files and headers, by their names.
        replayed: the macros of ``replay.c``: types and functions of the library, and words for its messages.
        records: (n, size) flag of memory that was reset, inputs, status and outputs of each call.
    """
    macros = "".join(f"#define {macro} {text}\n" for macro, text in replayed.items())
    program = f'#include "{name}.h"\n{macros}' + files("lgmpc.compile").joinpath("replay.c").read_text("utf-8")
    own = " ".join(each for each in sources if each.endswith(".c"))
    flags = " ".join(flag for flag in FLAGS if flag not in ("-fPIC", "-shared"))
    build = files("lgmpc.compile").joinpath("library.cmake").read_text("utf-8")
    build = build.replace("@NAME@", name).replace("@SOURCES@", own).replace("@FLAGS@", flags)
    texts = {**sources, "replay.c": program, "CMakeLists.txt": build}
    for file, text in texts.items():
        (folder / file).write_text(text, "utf-8")
    records.astype("<f8").tofile(folder / "records.bin")
