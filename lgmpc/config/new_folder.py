"""The folder of a run that is about to begin."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from lgmpc.config.loading import dump_config
from lgmpc.config.schema import Config, SolveConfig
from lgmpc.runs import RunFolder

__all__ = ["new_folder"]


@contextmanager
def new_folder(config: Config | SolveConfig, out: str | Path) -> Iterator[RunFolder]:
    """Lend ``out/<time>-<name>/`` with the config in it.

    It is made first, so that a run never ends with nowhere to go. If the block is left by an exception (the run cannot
    start, breaks, or cannot be saved) it is removed again, and so are ``out`` and the folders around it that did not
    exist before.

    Raises:
        RunFolderError: if it cannot be made or written.
    """
    out = Path(out)
    missing = [each for each in (out, *out.parents) if not each.exists()]
    folder = None
    try:
        folder = RunFolder.create(out, config.name)
        folder.write_config(dump_config(config))
        yield folder
    except BaseException:
        if folder is not None:
            shutil.rmtree(folder.path, ignore_errors=True)
        for each in missing:
            with suppress(OSError):  # another run is in it by now
                each.rmdir()
        raise
