"""Settings of all tests: reproducible property tests, one thread a process, Ctrl-C that works."""

import os
import signal

os.environ.setdefault("OMP_NUM_THREADS", "1")

from hypothesis import settings

settings.register_profile("lgmpc", deadline=None, derandomize=True)
settings.load_profile("lgmpc")

# A shell script's `pytest &` ignores SIGINT, and so do the programs that it starts; some tests send it to them.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
