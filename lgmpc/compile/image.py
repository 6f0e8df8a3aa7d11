"""Bound machine code as C sources: the functions, and the memory that they were bound to, with its addresses.

A frame (:func:`~lgmpc.compile.frame_of`) leads to all that its functions read and write. Its image is that memory as it
is now; ``image.c`` makes copies of it, with addresses of their own, in a program without Python.
"""

import ctypes
import functools
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from lgmpc.compile.compiler import FLAGS
from lgmpc.compile.native import function_at
from lgmpc.typing import Array

_WORD = 8
_ALIGNED = 8  # words, as memory of vectors is


def image_sources(root: Any) -> dict[str, str]:
    """Return the C sources, by file name, of a frame's memory and of all functions that it leads to.

    Args:
        root: the frame, ``lgmpc_image_root`` of a program.
    """
    parts: dict[int, tuple[int, Any]] = {}  # address, size and owner
    _collect(root, parts)
    blocks: list[list[int]] = []  # begin and end of memory without gaps
    for begin, (size, _) in sorted(parts.items()):
        if blocks and begin <= blocks[-1][1]:
            blocks[-1][1] = max(blocks[-1][1], begin + size)
        else:
            blocks.append([begin, begin + size])
    places, words = [], _ALIGNED  # the first words are image.c's own
    for begin, end in blocks:
        words += -(words - begin // _WORD) % _ALIGNED
        places.append(words)
        words += -(-(end - begin) // _WORD)

    begins = np.array([begin for begin, _ in blocks])

    def place(address: int) -> int | None:
        k = int(np.searchsorted(begins, address, side="right")) - 1
        inside = k >= 0 and address < blocks[k][1]
        return places[k] + (address - blocks[k][0]) // _WORD if inside else None

    content = np.zeros(words, dtype=np.uint64)
    for (begin, end), at in zip(blocks, places, strict=True):
        data = ctypes.string_at(begin, end - begin).ljust(-(-(end - begin) // _WORD) * _WORD, b"\0")
        content[at : at + len(data) // _WORD] = np.frombuffer(data, dtype=np.uint64)
    links, calls = [], []
    libraries: dict[int, Any] = {}
    for begin, (size, owner) in parts.items():
        if isinstance(owner, np.ndarray) and owner.dtype != np.uintp:
            continue
        first = place(begin)
        assert first is not None
        for at in range(first, first + size // _WORD):
            address = int(content[at])
            content[at] = 0
            to, function = place(address), function_at(address)
            if to is not None:
                links.append((at, to))
            elif function is not None:
                library, symbol = function
                libraries[id(library)] = library
                calls.append((at, library, symbol))
    numbers = {key: k for k, key in enumerate(libraries)}
    names = {(id(lib), symbol): f"{symbol}_{numbers[id(lib)]}" for _, lib, symbol in calls}
    sources = {}
    for key, library in libraries.items():
        own = [symbol for lib, symbol in names if lib == key]
        renamed = "".join(f"#define {symbol} {names[key, symbol]}\n" for symbol in own)
        for k, text in enumerate(library.sources()):
            sources[f"function_{numbers[key]}_{k}.c"] = renamed + text
    root_place = place(ctypes.addressof(root))
    used = np.flatnonzero(content)
    header = [
        "/* Sizes in words of 64 bits, constants, addresses within the memory, addresses of functions. */",
        *(f"int {name}(void**);" for name in names.values()),
        f"enum {{ SIZE = {words}, ROOT = {root_place} }};",
        "static const struct { unsigned at; uint64_t value; } WORDS[] = {",
        *(f"{{{at},{hex(content[at])}}}," for at in used.tolist()),
        "};\nstatic const struct { unsigned at, to; } LINKS[] = {",
        *(f"{{{at},{to}}}," for at, to in links),
        "};\nstatic const struct { unsigned at; int (*to)(void**); } CALLS[] = {",
        *(f"{{{at},{names[id(library), symbol]}}}," for at, library, symbol in calls),
        "};\n",
    ]
    image = files("lgmpc.compile").joinpath("image.c").read_text("utf-8")
    return sources | {"image.c": image, "image.h": "\n".join(header)}


def _collect(part: Any, parts: dict[int, tuple[int, Any]]) -> None:
    """Add the memory of arrays, frames and calls, and of all that frames lead to."""
    if isinstance(part, functools.partial):
        _collect(part.args[0]._obj, parts)
    elif isinstance(part, np.ndarray):
        begin, end = _extent(part)
        if end > begin and (begin not in parts or end - begin > parts[begin][0]):
            parts[begin] = end - begin, part
    elif isinstance(part, ctypes.Array):
        known = ctypes.addressof(part)
        if known not in parts and ctypes.sizeof(part):
            parts[known] = ctypes.sizeof(part), part
            for each in part.keep:  # type: ignore[attr-defined]
                _collect(each, parts)


def _extent(array: Array) -> tuple[int, int]:
    """Return the addresses of the first byte of an array and after its last."""
    begin, end = np.lib.array_utils.byte_bounds(array)
    return int(begin), int(end)


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
