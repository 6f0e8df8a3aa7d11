"""Export of a recorded run's controller as C libraries, with the ticks and the updates of the repeated run."""

import logging
from pathlib import Path

from lgmpc.compile import made_anew
from lgmpc.config.build import prepare
from lgmpc.config.closed_loop import ClosedLoopSession
from lgmpc.config.loading import parse_config
from lgmpc.errors import InputError
from lgmpc.mpc.export import UpdateRecorder
from lgmpc.runs import RunFolder
from lgmpc.runs.difference import first_difference
from lgmpc.runs.folder import CONFIG_FILE, DEPLOYMENT_FILE
from lgmpc.wbc.export import TickRecorder, write_tick_library

_LOG = logging.getLogger(__name__)
_EXPORTED_S = 10.0


def export_controller(run: str | Path, folder: Path) -> tuple[int, int]:
    """Write the controller of a run as C libraries: whole-body tick and, where it is centroidal, the MPC's update.

    The run is repeated up to its first change of settings, for 10 s at most: its ticks and updates are part of the
    folder; see :mod:`lgmpc.wbc.export` and, in the folder ``mpc``, :mod:`lgmpc.mpc.export`.

    Args:
        run: the run folder.
        folder: where the libraries are written, a new or an empty one.

    Returns:
        The numbers of ticks and of updates; the latter is 0 where the MPC cannot be written, which the log explains.

    Raises:
        InputError: the run is one of a robot, or is not repeated bit for bit (names tick and channel); the folder is
            not empty, or the whole-body controller cannot be written in C.
    """
    recorded = RunFolder.load(run)
    if (recorded.path / DEPLOYMENT_FILE).is_file():
        raise InputError("run", f"{recorded.path}, a run of a robot", "a simulated run, which can be repeated")
    config = parse_config(recorded.config, name=str(recorded.path / CONFIG_FILE), folder=recorded.path)
    if config.timing.computing == "measured":
        again = f"lgmpc run {recorded.path / CONFIG_FILE} --set timing.computing=modelled"
        raise InputError("timing.computing", "measured: no other run has its delays", f"ideal or modelled: {again}")
    with made_anew():
        session = prepare(config)
    assert isinstance(session, ClosedLoopSession)
    first, end = session.earlier[0] if session.earlier else (session, session.ticks.count)
    end = min(end, first.ticks.nearest(_EXPORTED_S))
    recorder, updates = TickRecorder(first.controller.wbc), _updates_of(first)
    first.advance(lambda _: None, end)
    repeated = first.recorder.log().decimated(config.log_every)
    difference = first_difference(recorded.log, repeated, until_s=float(repeated.time[-1]) + 1e-9)
    if difference is not None:
        words = f"{recorded.path}, which is not repeated bit for bit here: it differs first {difference}"
        raise InputError("run", words, f"one of this machine: lgmpc run {recorded.path / CONFIG_FILE}")
    write_tick_library(first.controller.wbc, recorder.ticks, folder)
    if updates is not None:
        updates.write(folder / "mpc")
    return len(recorder.ticks), 0 if updates is None else len(updates.updates)


def _updates_of(session: ClosedLoopSession) -> UpdateRecorder | None:
    """Return the recorder of the session's MPC; None where its update cannot be written in C."""
    planner = session.controller.planner
    if planner is None:
        return None
    try:
        return UpdateRecorder(planner.mpc)
    except InputError as error:
        _LOG.warning("the MPC's update is not written: %s", error)
        return None
