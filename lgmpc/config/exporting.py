"""Export of a recorded run's controller: its whole-body tick as a C library, with the ticks of the repeated run."""

from __future__ import annotations

from pathlib import Path

from lgmpc.config.build import prepare
from lgmpc.config.closed_loop import ClosedLoopSession
from lgmpc.config.loading import parse_config
from lgmpc.errors import InputError
from lgmpc.runs import RunFolder
from lgmpc.runs.difference import first_difference
from lgmpc.runs.folder import CONFIG_FILE, DEPLOYMENT_FILE
from lgmpc.wbc.export import TickRecorder, write_tick_library

__all__ = ["export_tick"]

_EXPORTED_S = 10.0


def export_tick(run: str | Path, folder: Path) -> int:
    """Write the whole-body tick of a run's controller as a C library; see :mod:`lgmpc.wbc.export`.

    The run is repeated up to its first change of settings, for 10 s at most: its ticks are part of the folder.

    Args:
        run: the run folder.
        folder: where the library is written, a new or an empty one.

    Returns:
        The number of ticks.

    Raises:
        InputError: the run is one of a robot, has measured computing times, or is not repeated bit for bit (names tick
            and channel); the folder is not empty, or the controller cannot be written in C.
    """
    recorded = RunFolder.load(run)
    if (recorded.path / DEPLOYMENT_FILE).is_file():
        raise InputError("run", f"{recorded.path}, a run of a robot", "a simulated run, which can be repeated")
    config = parse_config(recorded.config, name=str(recorded.path / CONFIG_FILE), folder=recorded.path)
    if config.timing.computing == "measured":
        again = f"lgmpc run {recorded.path / CONFIG_FILE} --set timing.computing=modelled"
        raise InputError("timing.computing", "measured: no other run has its delays", f"ideal or modelled: {again}")
    session = prepare(config)
    assert isinstance(session, ClosedLoopSession)
    first, end = session.earlier[0] if session.earlier else (session, session.rates.ticks)
    end = min(end, round(_EXPORTED_S / first.rates.period))
    recorder = TickRecorder(first.controller.wbc)
    first.advance(lambda _: None, end)
    repeated = first.recorder.log().decimated(config.log_every)
    difference = first_difference(recorded.log, repeated, until_s=float(repeated.time[-1]) + 1e-9)
    if difference is not None:
        words = f"{recorded.path}, which is not repeated bit for bit here: it differs first {difference}"
        raise InputError("run", words, f"one of this machine: lgmpc run {recorded.path / CONFIG_FILE}")
    write_tick_library(first.controller.wbc, recorder.ticks, folder)
    return len(recorder.ticks)
