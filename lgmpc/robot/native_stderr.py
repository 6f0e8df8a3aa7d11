"""Messages that native code prints to standard error."""

import os
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager

_capturing = threading.RLock()


@contextmanager
def native_stderr() -> Iterator[list[str]]:
    """Capture the output of native code to file descriptor 2; the list contains the text after the block.

    The descriptor is that of the whole process: one thread captures at a time.
    """
    printed: list[str] = []
    if sys.stderr is None:  # a process started without standard error: there is nothing to capture
        yield printed
        printed.append("")
        return
    with _capturing, tempfile.TemporaryFile() as file:
        sys.stderr.flush()
        saved = os.dup(2)
        os.dup2(file.fileno(), 2)
        try:
            yield printed
        finally:
            os.dup2(saved, 2)
            os.close(saved)
            file.seek(0)
            printed.append(file.read().decode(errors="replace"))
