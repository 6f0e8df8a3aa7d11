"""The rights of a real-time loop on this machine: scheduling, memory, cores, garbage collection."""

import ctypes
import gc
import logging
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

_LOG = logging.getLogger(__name__)
_CURRENT_AND_FUTURE = 3


@contextmanager
def real_time(priority: int = 0, cores: Sequence[int] = ()) -> Iterator[None]:
    """Run without garbage collection and, where the system permits it, with a real-time priority on given cores.

    What is not permitted is logged with the remedy, and left as it is.

    Args:
        priority: of SCHED_FIFO, 1 to 99, with memory locked; 0: as any other program.
        cores: that this thread may use; all unless given.
    """
    enabled, affinity, scheduling = gc.isenabled(), os.sched_getaffinity(0), os.sched_getscheduler(0)
    parameters = os.sched_getparam(0)
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        if cores:
            try:
                os.sched_setaffinity(0, cores)
            except OSError as error:
                _LOG.warning("deployment.cores: %s cannot be used (%s); this machine has %s", *_words(cores, error))
        if priority:
            raise_priority(priority)
        yield
    finally:
        os.sched_setscheduler(0, scheduling, parameters)
        os.sched_setaffinity(0, affinity)
        if enabled:
            gc.enable()
        gc.unfreeze()  # what is frozen at the end of a process is reported as leaked by extensions


def raise_priority(priority: int) -> None:
    """Ask for a real-time priority, 1 to 99, of this thread, and lock the process's memory; log what is refused."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except OSError as error:
        _LOG.warning(
            "deployment.priority: SCHED_FIFO %d is not permitted (%s): raise the limit rtprio of this user in"
            " /etc/security/limits.conf, or run as root",
            priority,
            error.strerror,
        )
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(_CURRENT_AND_FUTURE):
        _LOG.warning(
            "deployment.priority: memory cannot be locked (%s): raise the limit memlock of this user",
            os.strerror(ctypes.get_errno()),
        )


def _words(cores: Sequence[int], error: OSError) -> tuple[str, str, str]:
    return str(list(cores)), error.strerror or str(error), str(sorted(os.sched_getaffinity(0)))
