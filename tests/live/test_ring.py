"""The ring in shared memory: whole rows, in order, and only those that are still there."""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterator

import numpy as np
import pytest

from lgmpc.live.ring import RingReader, RingWriter

WIDTH = 200


@pytest.fixture
def ring() -> Iterator[RingWriter]:
    writer = RingWriter(WIDTH, slots=8)
    yield writer
    writer.close()


@pytest.fixture
def reader(ring: RingWriter) -> Iterator[RingReader]:
    reader = RingReader(ring.name, WIDTH)
    yield reader
    reader.close()


def rows(reader: RingReader) -> list[float]:
    return [float(row[0]) for row in reader.fresh()]


def test_rows_arrive_once_and_in_order(ring: RingWriter, reader: RingReader) -> None:
    assert rows(reader) == []
    for value in (1.0, 2.0, 3.0):
        ring.write(np.full(150, value), np.full(50, -value))
    first, *others = reader.fresh()
    assert first.tolist() == [1.0] * 150 + [-1.0] * 50
    assert [row[0] for row in others] == [2.0, 3.0]
    assert rows(reader) == []


def test_a_slow_reader_loses_the_oldest_rows(ring: RingWriter, reader: RingReader) -> None:
    for value in range(30):
        ring.write(np.full(WIDTH, float(value)))
    assert rows(reader) == [22.0, 23.0, 24.0, 25.0, 26.0, 27.0, 28.0, 29.0]


def test_a_row_that_is_being_written_is_not_read(ring: RingWriter, reader: RingReader) -> None:
    """The state of the memory at any moment of a write: the first number is cleared, or both differ."""
    for value in range(8):
        ring.write(np.full(WIDTH, float(value)))
    slot = ring._table[3]
    slot[0], slot[1:50] = 0.0, 99.0  # half written
    assert 3.0 not in (found := rows(reader)) and len(found) == 7


def hammer(name: str, ready: object, count: int) -> None:
    reader = RingReader(name, WIDTH)
    ready.release()  # type: ignore[attr-defined]
    seen, last = 0, -1.0
    while last < count - 1:
        for row in reader.fresh():
            assert (row == row[0]).all(), "torn"
            assert row[0] > last
            seen, last = seen + 1, float(row[0])
    reader.close()
    assert seen > 1


def test_no_row_is_torn_while_another_process_writes(ring: RingWriter) -> None:
    """Two slots, so that the writer laps the reader all the time."""
    narrow = RingWriter(WIDTH, slots=2)
    context, count = multiprocessing.get_context("spawn"), 20_000
    ready = context.Semaphore(0)
    process = context.Process(target=hammer, args=(narrow.name, ready, count))
    process.start()
    try:
        assert ready.acquire(timeout=30.0)
        row = np.empty(WIDTH)
        for value in range(count):
            row.fill(value)
            narrow.write(row)
        process.join(30.0)
        assert process.exitcode == 0
    finally:
        process.kill()
        process.join()
        narrow.close()
