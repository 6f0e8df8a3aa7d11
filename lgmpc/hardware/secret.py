"""The secret that both ends of a link share: a file that only its owner can read."""

import ipaddress
import logging
import os
import secrets
import stat
from pathlib import Path

from lgmpc.errors import InputError

_LOG = logging.getLogger(__name__)
_LEAST = 16  # B


def read_secret(path: str | Path | None = None) -> bytes:
    """Return the content of a secret's file, without white space at its ends.

    Args:
        path: file that no other user can read (mode 0600), of at least 16 bytes. Unless given, the user's own
            ``link.secret`` beside other programs' settings, which is made at its first use; programs of one user on one
            machine need no other.

    Raises:
        InputError: if the file cannot be read or made, is short, or can be read by others.
    """
    own = path is None
    file = _own_file() if path is None else Path(path)
    try:
        if own and not file.exists():
            _make(file)
        descriptor = os.open(file, os.O_RDONLY)
        with open(descriptor, "rb") as opened:
            mode, content = os.fstat(descriptor).st_mode, opened.read(4096).strip()
    except OSError as error:
        raise InputError("secret", str(file), f"a file that can be read ({error.strerror or error})") from error
    if not stat.S_ISREG(mode) or mode & 0o077:
        raise InputError("secret", f"{file}, of mode {mode & 0o777:o}", f"a file of mode 600 (chmod 600 {file})")
    if len(content) < _LEAST:
        raise InputError("secret", f"{file}, {len(content)} bytes", f"at least {_LEAST} bytes: openssl rand -hex 32")
    return content


def warn_of_network(host: str) -> None:
    """Log a warning if an address is not that of this machine alone."""
    try:
        local = ipaddress.ip_address(host).is_loopback
    except ValueError:
        local = host == "localhost"
    if not local:
        _LOG.warning(
            "the link uses a network (%s): its packets can be read and held up by others there, but not forged without"
            " the secret; use a network of the robot's own",
            host,
        )


def _own_file() -> Path:
    from platformdirs import user_config_path

    return user_config_path("lgmpc") / "link.secret"


def _make(file: Path) -> None:
    """Make the file with a random content, unless another process does so at the same time."""
    file.parent.mkdir(parents=True, exist_ok=True)
    draft = file.with_name(f"{file.name}.{os.getpid()}")
    with open(os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as opened:
        opened.write(secrets.token_hex(32) + "\n")
    try:
        os.link(draft, file)
    except FileExistsError:
        pass
    finally:
        draft.unlink()
