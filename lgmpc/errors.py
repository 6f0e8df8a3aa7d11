"""The exceptions that lgmpc raises, with what their messages state as attributes.

All derive from :class:`LgmpcError`. The command line prints the message and returns the exit code; programs read the
attributes.
"""

from __future__ import annotations

import difflib
import signal
from collections.abc import Iterable, Sequence

__all__ = [
    "ClusterError",
    "CompileError",
    "ConfigError",
    "ConfigErrors",
    "InputError",
    "Interrupted",
    "LgmpcError",
    "MissingDependencyError",
    "ModelError",
    "ReplayError",
    "RunFolderError",
    "SolverError",
    "as_one_error",
    "nearest",
]


MOST_CHOICES = 12
"""Number of valid choices that a message lists; the attribute ``choices`` has all."""


def nearest(word: str, choices: Iterable[str], count: int = 3) -> tuple[str, ...]:
    """Return up to ``count`` of ``choices`` that are most similar to ``word``, best first (case is ignored)."""
    by_lower = {choice.lower(): choice for choice in choices}
    hits = difflib.get_close_matches(word.lower(), by_lower, n=count, cutoff=0.5)
    return tuple(by_lower[hit] for hit in hits)


class LgmpcError(Exception):
    """Base class of all exceptions that lgmpc raises.

    Attributes:
        exit_code: what the command line returns for it (2 = bad input, 1 = it ran and failed).
    """

    exit_code = 2


class InputError(LgmpcError, ValueError):
    """An argument that cannot be used.

    Args:
        argument: name of the argument or config key.
        got: the value received, as the message shows it.
        expected: the values accepted, in words.
        choices: the valid values, if they can be listed; the nearest are shown.
        word: what the choices are compared with to find the nearest; ``got`` unless given.
    """

    def __init__(
        self, argument: str, got: object, expected: str, choices: Sequence[str] = (), *, word: str | None = None
    ) -> None:
        self.argument = argument
        self.got = got
        self.expected = expected
        self.choices = tuple(choices)
        self.suggestions = nearest(str(got) if word is None else word, self.choices)
        super().__init__(self._message())

    def _message(self) -> str:
        text = f"{self.argument}: got {self.got}; expected {self.expected}"
        if self.suggestions:
            return f"{text}. Did you mean {' or '.join(self.suggestions)}?"
        if self.choices:
            more = len(self.choices) - MOST_CHOICES
            rest = f" and {more} more" if more > 0 else ""
            return f"{text}. Valid: {', '.join(self.choices[:MOST_CHOICES])}{rest}"
        return text


class ConfigError(InputError):
    """A config key that is unknown, missing, or whose value cannot be used.

    Args:
        file: the YAML file (or ``--set``) that contains the key.
        key: dotted path of the key.
        got: the value received.
        expected: the values accepted.
        choices: valid keys or values.
        word: what the choices are compared with to find the nearest; ``got`` unless given.

    Attributes:
        problems: this error alone; all of them in a :class:`ConfigErrors`.
    """

    def __init__(
        self,
        file: str,
        key: str,
        got: object,
        expected: str,
        choices: Sequence[str] = (),
        *,
        word: str | None = None,
    ) -> None:
        self.file = file
        self.key = key
        self.problems: tuple[ConfigError, ...] = (self,)
        super().__init__(f"{file}: {key}" if key else file, got, expected, choices, word=word)


class ConfigErrors(ConfigError):
    """Several problems of one config; the other attributes are those of the first."""

    def __init__(self, problems: Sequence[ConfigError]) -> None:
        first = problems[0]
        super().__init__(first.file, first.key, first.got, first.expected, first.choices)
        self.suggestions = first.suggestions
        self.problems = tuple(problems)
        self.args = (f"{len(problems)} problems:\n" + "\n".join(f"  - {p}" for p in self.problems),)


def as_one_error(found: Sequence[ConfigError]) -> ConfigError:
    """Return the only problem of a config, or all of several as one error."""
    return found[0] if len(found) == 1 else ConfigErrors(found)


class ModelError(LgmpcError):
    """A robot model that cannot be used; ``problems`` lists all that was found."""

    def __init__(self, robot: str, problems: Sequence[str]) -> None:
        self.robot = robot
        self.problems = tuple(problems)
        super().__init__(f"robot '{robot}' cannot be used:\n" + "\n".join(f"  - {p}" for p in self.problems))


class CompileError(LgmpcError):
    """The C compiler failed; ``log`` is its output."""

    def __init__(self, function: str, command: str, log: str) -> None:
        self.function = function
        self.command = command
        self.log = log
        super().__init__(f"compiling '{function}' failed: {command}\n{log[-2000:]}")


class SolverError(LgmpcError):
    """A solver stopped without a solution and the caller requested an exception (``throw=True``)."""

    exit_code = 1

    def __init__(self, solver: str, status: str, remedy: str) -> None:
        self.solver = solver
        self.status = status
        self.remedy = remedy
        super().__init__(f"{solver}: {status}. {remedy}")


class ClusterError(LgmpcError):
    """Worker processes on other machines that cannot be used, or whose connection is lost."""


class MissingDependencyError(LgmpcError):
    """A package that an optional part requires is not installed; the message contains the command that installs it."""

    def __init__(self, package: str, needed_for: str, install: str) -> None:
        self.package = package
        self.needed_for = needed_for
        self.install = install
        super().__init__(f"{needed_for} needs the package '{package}'. Install it with: {install}")


class Interrupted(KeyboardInterrupt):
    """A signal that stops a run: Ctrl-C, SIGTERM or SIGHUP.

    Attributes:
        signal: the signal received.
        exit_code: what the command line returns for it, 128 + the signal's number.
    """

    def __init__(self, signal: signal.Signals) -> None:
        self.signal = signal
        self.exit_code = 128 + signal
        super().__init__(signal.name)


class ReplayError(LgmpcError):
    """A recorded run was not repeated bit for bit.

    Attributes:
        run: folder of the recorded run.
        difference: the first :class:`lgmpc.runs.difference.Difference`.
    """

    exit_code = 1

    def __init__(self, run: str, difference: object, reason: str) -> None:
        self.run = run
        self.difference = difference
        super().__init__(
            f"{run} was not repeated bit for bit: it differs first {difference}. {reason} Run its config anew here, and"
            f" continue that: lgmpc run {run}/config.yaml"
        )


class RunFolderError(LgmpcError):
    """A run folder that cannot be written or read."""
