"""What all tests share: reproducible property tests, one thread for small matrices."""

import os
import signal

os.environ.setdefault("OMP_NUM_THREADS", "1")

from hypothesis import settings

settings.register_profile("lgmpc", deadline=None, derandomize=True)
settings.load_profile("lgmpc")

# A shell script's `pytest &` is born deaf to Ctrl-C, and so are the programs it starts; some tests press it.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
