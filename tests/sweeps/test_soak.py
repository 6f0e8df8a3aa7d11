"""Random runs, standing and walking, in worlds far beyond what is asked: nothing raises, every log is whole."""

from pathlib import Path

import numpy as np
import pytest

from lgmpc.runs import RunFolder
from lgmpc.sweeps import Ending, load_sweep, run_sweep


@pytest.mark.slow
def test_no_random_run_breaks(tmp_path: Path) -> None:
    """A part of ``lgmpc sweep soak``, which has more draws."""
    sweep = load_sweep("soak", ["samples.count=3", "set.duration_s=0.9", "logs.keep=6"])
    finished = run_sweep(sweep, tmp_path / "soak", workers=1)
    broken = {row.reasons for row in finished.rows.values() if not row.ending.computed}
    assert not broken, f"configs that repeat them: {sorted((tmp_path / 'soak' / 'logs').glob('broken-*'))}"
    assert [row.ending for row in finished.rows.values()] == [Ending.PASS] * 6
    for row in finished.rows.values():
        run = RunFolder.load(tmp_path / "soak" / "logs" / row.log)
        log, metrics = run.log, run.result.metrics
        assert metrics is not None
        assert np.isfinite(log.tau_command).all() and np.isfinite(log.q).all()
        end = float(log.time[-1]) + 2.0 * log.control_period_s
        assert end >= min(0.9, metrics.survived_s + 0.3) - 0.06  # falls are looked for every 0.05 s
