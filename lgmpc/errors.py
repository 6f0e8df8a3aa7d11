"""The exceptions that lgmpc raises, with what their messages state as attributes.

All derive from :class:`LgmpcError`. The command line prints the message and returns the exit code; programs read the
attributes.
"""

import copyreg
import difflib
import importlib
import signal
import traceback
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

MOST_CHOICES = 12
"""Number of valid choices that a message lists; the attribute ``choices`` has all."""

MOST_PROBLEMS, MOST_LINES = 10, 20
"""Number of problems that a message lists, and their lines of 80 characters; the attribute ``problems`` has all."""

LONGEST_VALUE, LONGEST_MESSAGE = 300, 6000
"""Characters of a received value in a message, and of a whole message; attributes have all."""


def shortened(text: str, most: int = LONGEST_VALUE) -> str:
    """Return ``text``, or its beginning and its end if it has more than ``most`` characters."""
    half = (most - 5) // 2
    return text if len(text) <= most else f"{text[:half]} ... {text[-half:]}"


def legible(text: str) -> str:
    """Return ``text`` with its control characters escaped, but for ends of lines and bytes of paths.

    Names of a config or a robot model may contain such characters, which terminals take for commands.
    """
    return "".join(
        c if c.isprintable() or c == "\n" or "\udc80" <= c <= "\udcff" else c.encode("unicode_escape").decode()
        for c in text
    )


def nearest(word: str, choices: Iterable[str], count: int = 3) -> tuple[str, ...]:
    """Return up to ``count`` of ``choices`` that are most similar to ``word``, best first (case is ignored)."""
    by_lower = {choice.lower(): choice for choice in choices}
    hits = difflib.get_close_matches(word.lower(), by_lower, n=count, cutoff=0.5)
    return tuple(by_lower[hit] for hit in hits)


def _reduce(error: BaseException) -> tuple[Any, ...]:
    """Reduce an exception to message and attributes; Python's own reduction calls the class with the message alone."""
    return copyreg.__newobj__, (type(error), *error.args), error.__dict__  # type: ignore[attr-defined]


def cause_of(error: BaseException) -> str:
    """Return an exception in one line: its message and, unless it is lgmpc's own, its type, file and line."""
    message = shortened(" ".join(str(error).split()))
    if isinstance(error, LgmpcError):
        return message
    frames = traceback.extract_tb(error.__traceback__)
    place = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""
    return f"{type(error).__name__}{': ' if message else ''}{message}{place}"


class LgmpcError(Exception):
    """Base class of all exceptions that lgmpc raises. They can be pickled.

    Attributes:
        exit_code: what the command line returns for it (2 = bad input, 1 = it ran and failed).
    """

    exit_code = 2

    __reduce__ = _reduce

    def __str__(self) -> str:
        return legible(shortened(super().__str__(), LONGEST_MESSAGE))


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
        self.argument, self.got, self.expected = argument, got, expected
        self.choices = tuple(choices)
        self.suggestions = nearest(str(got) if word is None else word, self.choices)
        super().__init__(self._message())

    def _message(self) -> str:
        argument, got = (shortened(str(each)).replace("\n", "\\n") for each in (self.argument, self.got))
        text = f"{argument}: got {got}; expected {shortened(self.expected, 2 * LONGEST_VALUE)}"
        if self.suggestions:
            return f"{text}. Did you mean {' or '.join(map(shortened, self.suggestions))}?"
        if self.choices:
            more = len(self.choices) - MOST_CHOICES
            rest = f" and {more} more" if more > 0 else ""
            return f"{text}. Valid: {', '.join(map(shortened, self.choices[:MOST_CHOICES]))}{rest}"
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
        self, file: str, key: str, got: object, expected: str, choices: Sequence[str] = (), *, word: str | None = None
    ) -> None:
        self.file, self.key = file, key
        self.problems: tuple[ConfigError, ...] = (self,)
        super().__init__(f"{file}: {key}" if key else file, got, expected, choices, word=word)


class ConfigErrors(ConfigError):
    """Several problems of one config; the other attributes are those of the first."""

    def __init__(self, problems: Sequence[ConfigError]) -> None:
        first = problems[0]
        super().__init__(first.file, first.key, first.got, first.expected, first.choices)
        self.suggestions = first.suggestions
        self.problems = tuple(problems)
        self.args = (f"{len(problems)} problems in the config:\n{_listed(self.problems)}",)


def _listed(problems: Sequence[object]) -> str:
    more = len(problems) - MOST_PROBLEMS
    rest = [f"  ... and {more} more"] if more > 0 else []
    length = 80 * (MOST_LINES // max(1, min(len(problems), MOST_PROBLEMS))) - 4
    return "\n".join([*(f"  - {shortened(str(each), length)}" for each in problems[:MOST_PROBLEMS]), *rest])


def as_one_error(found: Sequence[ConfigError]) -> ConfigError:
    """Return the only problem of a config, or all of several as one error."""
    return found[0] if len(found) == 1 else ConfigErrors(found)


class ModelError(LgmpcError):
    """A robot model that cannot be used; ``problems`` lists all that was found."""

    def __init__(self, robot: str, problems: Sequence[str]) -> None:
        self.robot = robot
        self.problems = tuple(problems)
        super().__init__(f"robot '{shortened(robot)}' cannot be used:\n{_listed(self.problems)}")


class CompileError(LgmpcError):
    """The C compiler failed; ``log`` is its output."""

    def __init__(self, function: str, command: str, log: str) -> None:
        self.function, self.command, self.log = function, command, log
        super().__init__(f"compiling '{function}' failed: {shortened(command)}\n{log[-2000:]}")


class SolverError(LgmpcError):
    """A solver stopped without a solution and the caller requested an exception (``throw=True``)."""

    exit_code = 1

    def __init__(self, solver: str, status: str, remedy: str) -> None:
        self.solver, self.status, self.remedy = solver, status, remedy
        super().__init__(f"{solver}: {status}. {remedy}")


class MissingDependencyError(LgmpcError):
    """A package that an optional part requires is not installed; the message contains the command that installs it."""

    def __init__(self, package: str, needed_for: str, install: str) -> None:
        self.package, self.needed_for, self.install = package, needed_for, install
        super().__init__(f"{needed_for} needs the package '{package}'. Install it with: {install}")


def required(module: str, needed_for: str, extra: str) -> Any:
    """Return a module of an optional package.

    Args:
        module: its name.
        needed_for: what needs it, in words.
        extra: the extra of lgmpc that brings it.

    Raises:
        MissingDependencyError: it is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise MissingDependencyError(module, needed_for, f'pip install "lgmpc[{extra}]"') from error


class Interrupted(KeyboardInterrupt):
    """A signal that stops a run: Ctrl-C, SIGTERM or SIGHUP.

    Attributes:
        signal: the signal received.
        exit_code: what the command line returns for it, 128 + the signal's number.
    """

    __reduce__ = _reduce

    def __init__(self, signal: signal.Signals) -> None:
        self.signal = signal
        self.exit_code = 128 + signal
        super().__init__(signal.name)


class RunFolderError(LgmpcError):
    """A run folder that cannot be written or read."""
