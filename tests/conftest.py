"""What all tests share: reproducible property tests, one thread for small matrices."""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

from hypothesis import settings

settings.register_profile("lgmpc", deadline=None, derandomize=True)
settings.load_profile("lgmpc")
