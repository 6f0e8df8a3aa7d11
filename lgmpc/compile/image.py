"""Bound machine code as C sources: the functions, and the memory that they were bound to, with its addresses.

A frame (:func:`~lgmpc.compile.frame_of`) leads to all that its functions read and write. Its image is that memory as it
is now; ``image.c`` makes copies of it, with addresses of their own, in a program without Python.
"""

import ctypes
import functools
from bisect import bisect_right
from collections.abc import Mapping
from importlib.resources import files
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
    memory = _Memory(parts)
    words, links, calls = memory.words(), [], []
    for begin, (size, owner) in parts.items():
        if isinstance(owner, np.ndarray) and owner.dtype != np.uintp:
            continue  # numbers
        first = memory.place(begin)
        assert first is not None
        for at in range(first, first + size // _WORD):
            address, words[at] = int(words[at]), 0
            if (to := memory.place(address)) is not None:
                links.append((at, to))
            elif (function := function_at(address)) is not None:
                calls.append((at, *function))
    libraries = list({id(library): library for _, library, _ in calls}.values())
    numbers = {id(library): k for k, library in enumerate(libraries)}
    names = {(id(library), symbol): f"{symbol}_{numbers[id(library)]}" for _, library, symbol in calls}
    sources = {}
    for number, library in enumerate(libraries):
        own = [symbol for key, symbol in names if key == id(library)]
        renamed = "".join(f"#define {symbol} {symbol}_{number}\n" for symbol in own)
        for k, text in enumerate(library.sources()):
            sources[f"function_{number}_{k}.c"] = renamed + text
    header = [
        "/* Sizes in words of 64 bits, constants, addresses within the memory, addresses of functions. */",
        *(f"int {name}(void**);" for name in names.values()),
        f"enum {{ SIZE = {len(words)}, ROOT = {memory.place(ctypes.addressof(root))} }};",
        "static const struct { unsigned at; uint64_t value; } WORDS[] = {",
        *(f"{{{at},{hex(words[at])}}}," for at in np.flatnonzero(words).tolist()),
        "};\nstatic const struct { unsigned at, to; } LINKS[] = {",
        *(f"{{{at},{to}}}," for at, to in links),
        "};\nstatic const struct { unsigned at; int (*to)(void**); } CALLS[] = {",
        *(f"{{{at},{names[id(library), symbol]}}}," for at, library, symbol in calls),
        "};\n",
    ]
    image = files("lgmpc.compile").joinpath("image.c").read_text("utf-8")
    return sources | {"image.c": image, "image.h": "\n".join(header)}


class _Memory:
    """Blocks of memory without gaps, and where each begins in a copy of them, in words; the first are image.c's own."""

    def __init__(self, parts: Mapping[int, tuple[int, Any]]) -> None:
        blocks: list[list[int]] = []  # begin and end
        for begin, (size, _) in sorted(parts.items()):
            if blocks and begin <= blocks[-1][1]:
                blocks[-1][1] = max(blocks[-1][1], begin + size)
            else:
                blocks.append([begin, begin + size])
        self._blocks, self._size, self._places = blocks, _ALIGNED, list[int]()
        for begin, end in blocks:
            self._size += -(self._size - begin // _WORD) % _ALIGNED
            self._places.append(self._size)
            self._size += -(-(end - begin) // _WORD)

    def place(self, address: int) -> int | None:
        """Return the word of the copy that an address is in; None outside the memory."""
        k = bisect_right(self._blocks, address, key=itemgetter(0)) - 1
        inside = k >= 0 and address < self._blocks[k][1]
        return self._places[k] + (address - self._blocks[k][0]) // _WORD if inside else None

    def words(self) -> NDArray[np.uint64]:
        """Return the copy, as the memory is now."""
        words = np.zeros(self._size, dtype=np.uint64)
        for (begin, end), at in zip(self._blocks, self._places, strict=True):
            data = ctypes.string_at(begin, end - begin).ljust(-(-(end - begin) // _WORD) * _WORD, b"\0")
            words[at : at + len(data) // _WORD] = np.frombuffer(data, dtype=np.uint64)
        return words


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
