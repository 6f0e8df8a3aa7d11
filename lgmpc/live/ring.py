"""A ring of rows in shared memory: one process writes and never waits, another reads what is still there.

Every slot begins and ends with its row's number, counted from 1, and the writer clears the first of both while it
writes: a reader that copies a slot meanwhile finds numbers that differ, and discards the copy. Rows that the writer has
overwritten are lost to a reader that is too slow, never the other way round.
"""

from collections.abc import Iterator
from multiprocessing.shared_memory import SharedMemory

import numpy as np

from lgmpc.typing import Array

PICTURE_S = 1.0 / 60.0
"""Least time between two pictures, s."""
EXTRAS = 8
"""Numbers of a picture besides the rows of the recorder: simulated over elapsed time, whether time stands still, the
number of the gait, and the ground as the controller believes it to be: slope (2) and a point (3)."""
_SLOTS = 64


class RingWriter:
    """The writing end, which owns the memory.

    Args:
        width: numbers of a row.
        slots: rows that are kept.

    Attributes:
        written: number of rows so far.
    """

    def __init__(self, width: int, slots: int = _SLOTS) -> None:
        self._memory = SharedMemory(create=True, size=8 * (1 + slots * (width + 2)))
        self._last, self._table = _views(self._memory, width)
        self._last[0] = self.written = 0

    @property
    def name(self) -> str:
        """Name of the memory, for the reader."""
        return self._memory.name

    def write(self, *parts: Array) -> None:
        """Write one row, given in consecutive parts; takes some microseconds, whatever the reader does."""
        slot, number = self._table[self.written % len(self._table)], self.written + 1
        slot[0] = 0.0
        start = 1
        for part in parts:
            end = start + part.size
            slot[start:end] = part
            start = end
        slot[-1] = slot[0] = number
        self._last[0] = self.written = number

    def close(self) -> None:
        """Give the memory back; a reader that still has it may go on."""
        del self._last, self._table
        self._memory.close()
        self._memory.unlink()


class RingReader:
    """The reading end.

    Args:
        name: of the memory.
        width: numbers of a row.
    """

    def __init__(self, name: str, width: int) -> None:
        self._memory = SharedMemory(name)
        self._last, self._table = _views(self._memory, width)
        self._read = 0

    def fresh(self) -> Iterator[Array]:
        """Yield copies of the rows since the last call, oldest first, as far as they are still there and whole."""
        last = int(self._last[0])
        first = max(self._read, last - len(self._table)) + 1
        self._read = last
        for number in range(first, last + 1):
            slot = self._table[(number - 1) % len(self._table)]
            row = slot.copy()
            if row[0] == row[-1] == slot[0] == number:
                yield row[1:-1]

    def close(self) -> None:
        """Detach from the memory."""
        del self._last, self._table
        self._memory.close()


def _views(memory: SharedMemory, width: int) -> tuple[Array, Array]:
    """Return the number of the last row, and the slots."""
    numbers: Array = np.ndarray(memory.size // 8, buffer=memory.buf)  # the memory may be larger than asked for
    slots = (len(numbers) - 1) // (width + 2)
    return numbers[:1], numbers[1 : 1 + slots * (width + 2)].reshape(slots, width + 2)
