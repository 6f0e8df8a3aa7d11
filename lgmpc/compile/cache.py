"""The cache of shared libraries: a private folder of files whose names verify their content.

An entry is one file, ``<function>-<key>-<digest>.so``: the key is a hash of what it was built from, the digest one of
its bytes, so that a truncated or altered file is detected before it is loaded. Entries are created by an atomic rename.
"""

import contextlib
import fcntl
import hashlib
import logging
import os
import shutil
import stat
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import platformdirs

from lgmpc.errors import CompileError, InputError

_log = logging.getLogger("lgmpc.compile")
_DIGEST = 16
_FOLDER_MODE, _FILE_MODE = 0o700, 0o600
_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
_STALE_S = 24 * 3600.0
_ATTEMPTS = 3
"""Number of attempts to build a library whose folder is removed meanwhile."""


@dataclass(frozen=True)
class CacheReport:
    """The content of the cache.

    Attributes:
        folder: of the cache.
        entries: number of libraries.
        size_bytes: of all files in it.
        damaged: names of the libraries whose content does not match their name.
    """

    folder: Path
    entries: int
    size_bytes: int
    damaged: tuple[str, ...]


def request_key(*parts: str) -> str:
    """Return the hash of what an entry is built from: 32 hexadecimal digits."""
    digest = hashlib.sha256()
    for part in parts:
        data = part.encode()
        digest.update(len(data).to_bytes(8, "little") + data)
    return digest.hexdigest()[:32]


def cache_folder() -> Path:
    """Return the folder of compiled libraries, created if necessary and checked to be writable by this user alone.

    Code is loaded from it, so a user with write access to it can run anything as this user.

    Raises:
        InputError: the folder cannot be used, or others may write to it or replace it; the message states the remedy.
    """
    chosen = os.environ.get("LGMPC_CACHE_DIR", "").strip()
    path = Path(chosen).expanduser() if chosen else Path(platformdirs.user_cache_dir("lgmpc"))
    try:
        path.mkdir(mode=_FOLDER_MODE, parents=True, exist_ok=True)
        folder = path.resolve(strict=True)
        info = folder.stat()
    except (OSError, RuntimeError) as error:
        raise _refuse(path, f"which cannot be created or read ({error})", "a folder that you can write to") from error
    _check_folder(folder, info)
    for parent in folder.parents:
        mode = parent.stat().st_mode
        if mode & _OTHERS_WRITE and not mode & stat.S_ISVTX:
            raise _refuse(
                folder,
                f"which others may replace, since they may write to {parent} (mode {stat.S_IMODE(mode):04o})",
                "a folder in a place that only you may write to",
            )
    return folder


def private_folder(folder: Path) -> Path:
    """Return a folder within the cache, created if necessary and checked as the cache itself is.

    Raises:
        InputError: it is a symbolic link, or others may write to it.
        OSError: it cannot be created.
    """
    with contextlib.suppress(OSError):
        folder.mkdir(mode=_FOLDER_MODE)
    _check_folder(folder, folder.lstat())
    return folder


def _check_folder(folder: Path, info: os.stat_result) -> None:
    if not stat.S_ISDIR(info.st_mode):
        kind = "a symbolic link" if stat.S_ISLNK(info.st_mode) else "not a folder"
        raise _refuse(folder, f"which is {kind}", "a folder")
    if info.st_uid != os.geteuid():
        raise _refuse(folder, f"which belongs to another user (uid {info.st_uid})", "a folder that you own")
    if info.st_mode & _OTHERS_WRITE:
        raise _refuse(
            folder,
            f"which others may write to (mode {stat.S_IMODE(info.st_mode):04o})",
            f"a folder that only you may write to: chmod 700 '{folder}' if no other user has written to it",
        )


def read_private(path: Path) -> bytes | None:
    """Return the bytes of a file that only this user can have written; None if there is none.

    A symbolic link, another user's file, or one that others may write to is reported to the log.
    """
    try:
        with open(os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK), "rb") as file:
            info = os.fstat(file.fileno())
            mode = stat.S_IMODE(info.st_mode)
            if stat.S_ISREG(info.st_mode) and info.st_uid == os.geteuid() and not mode & _OTHERS_WRITE:
                return file.read()
            reason = f"uid {info.st_uid}, mode {mode:04o}"
    except FileNotFoundError:
        return None
    except OSError as error:
        reason = "a symbolic link" if path.is_symlink() else str(error)
    _log.warning("cache entry %s is not used: others may have written it (%s)", path.name, reason)
    return None


def write_private(path: Path, data: bytes) -> None:
    """Write a file that only this user may read, at once: readers see the whole or nothing."""
    with tempfile.NamedTemporaryFile(dir=path.parent, prefix=".", delete=False) as file:  # of mode 0600
        file.write(data)
    os.replace(file.name, path)


def _refuse(folder: Path, what: str, expected: str) -> InputError:
    hint = f"{expected}; or choose another with LGMPC_CACHE_DIR, or run interpreted with LGMPC_JIT=0"
    return InputError("cache of compiled functions", f"'{folder}', {what}", hint)


def find_entry(folder: Path, name: str, key: str) -> Path | None:
    """Return the library built for this request, or None; a damaged one is removed and reported to the log."""
    for path in sorted(folder.glob(f"{name}-{key}-*.so")):
        if is_whole(path):
            return path
        _log.warning("cache entry %s is damaged: it is built again", path.name)
        discard(path)
    return None


class _RemovedError(Exception):
    """The cache was removed while a library was built in it."""


def make_entry(
    folder: Path,
    name: str,
    key: str,
    sources: Sequence[str],
    build: Callable[[Sequence[Path], Path], None],
    waiting: Callable[[], None],
) -> Path:
    """Build a library and add it to the cache, unless another process has done so.

    Args:
        folder: the cache.
        name: of the function.
        key: of the request.
        sources: C code, one a file.
        build: called with the C files and the library to write; once more if the cache was removed meanwhile.
        waiting: called once if another process is building it.

    Returns:
        The file of the finished entry.

    Raises:
        InputError: the folder cannot be written.
        CompileError: from ``build``.
    """

    def attempt() -> Path:
        try:
            with _locked(folder / f".{name}-{key}.lock", waiting):
                entry = find_entry(folder, name, key)
                if entry is not None:
                    return entry
                _remove_stale(folder)
                with tempfile.TemporaryDirectory(prefix=".build-", dir=folder) as scratch:
                    files = [Path(scratch, f"{name}{i or ''}.c") for i in range(len(sources))]
                    library = Path(scratch, f"{name}.so")
                    try:
                        for file, source in zip(files, sources, strict=True):
                            file.write_text(source)
                        build(files, library)
                        library.chmod(_FILE_MODE)
                        entry = folder / f"{name}-{key}-{_digest(library.read_bytes())}.so"
                        library.replace(entry)
                    except (OSError, CompileError) as error:
                        if not all(file.exists() for file in files):
                            raise _RemovedError from error
                        raise
                return entry
        except FileNotFoundError as error:
            if folder.is_dir():
                raise
            raise _RemovedError from error

    try:
        for _ in range(_ATTEMPTS):
            folder.mkdir(mode=_FOLDER_MODE, parents=True, exist_ok=True)
            with contextlib.suppress(_RemovedError):
                return attempt()
        raise OSError("another process removes it repeatedly")
    except OSError as error:
        raise _refuse(folder, f"which cannot be written ({error})", "a folder that you can write to") from error


def discard(path: Path) -> None:
    """Remove a file, if it exists and can be removed."""
    with contextlib.suppress(OSError):
        path.unlink()


def inspect_cache(folder: Path) -> CacheReport:
    """Count and verify the libraries of a cache, and add up the sizes of all files, while others may change them."""
    libraries, size = sorted(folder.glob("*.so")), 0
    for where, _, names in os.walk(folder):
        for name in names:
            with contextlib.suppress(FileNotFoundError):
                size += os.stat(os.path.join(where, name)).st_size
    return CacheReport(folder, len(libraries), size, tuple(path.name for path in libraries if not is_whole(path)))


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:_DIGEST]


def is_whole(path: Path) -> bool:
    """Return whether a library exists, was written by this user and has the content that its name states."""
    data = read_private(path)
    return data is not None and _digest(data) == path.stem[-_DIGEST:]


def _remove_stale(folder: Path) -> None:
    """Remove the files of interrupted compilations."""
    for path in folder.glob(".build-*"):
        with contextlib.suppress(OSError):
            if time.time() - path.stat().st_mtime > _STALE_S:
                shutil.rmtree(path, ignore_errors=True)


@contextlib.contextmanager
def _locked(path: Path, waiting: Callable[[], None]) -> Iterator[None]:
    """Hold an advisory lock so that two processes do not compile the same function.

    It only saves work: entries are created by an atomic rename, so that two processes that build at once (without file
    locks, or when the lock's file has just been removed) produce the same entry.
    """
    with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_NOFOLLOW, _FILE_MODE), "w") as handle:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            waiting()
            fcntl.flock(handle, fcntl.LOCK_EX)
        except OSError:
            _log.debug("no file locks in %s", path.parent)
        try:
            yield
        finally:
            discard(path)
