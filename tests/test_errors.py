"""Exceptions: their messages, and their way through pickle to another process."""

import pickle
import signal
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import pytest

from lgmpc import errors
from lgmpc.config import parse_config
from lgmpc.costs.symbols import MissingQuantityError
from lgmpc.hardware.simulated import NoControllerError

CONFIG = errors.ConfigError("f.yaml:3", "mpc.nods", 1, "a key of mpc", ["mpc.nodes"], word="mpc.nods")
EXAMPLES: dict[type[BaseException], BaseException] = {
    type(each): each
    for each in (
        errors.LgmpcError("words"),
        errors.InputError("mu", -1.0, "a number above 0", ["0.5", "0.6"]),
        CONFIG,
        errors.ConfigErrors([CONFIG, errors.ConfigError("f.yaml", "", "nothing", "a config")]),
        errors.ModelError("arm", ["no mass", "no feet"]),
        errors.CompileError("f", "cc -c f.c", "f.c:1: error"),
        errors.SolverError("fddp", "stalled", "Relax it."),
        errors.MissingDependencyError("meshcat", "the replay", "pip install meshcat"),
        errors.Interrupted(signal.SIGTERM),
        errors.RunFolderError("runs/a cannot be read"),
        MissingQuantityError("contact_forces", "friction cone", ["state"]),
        NoControllerError("no command"),
    )
}


def subclasses(kind: type[BaseException]) -> set[type[BaseException]]:
    return {kind}.union(*map(subclasses, kind.__subclasses__()))


def facts(error: BaseException) -> tuple[object, ...]:
    attributes = {name: value for name, value in vars(error).items() if name != "problems"}
    return type(error), str(error), attributes, [str(each) for each in getattr(error, "problems", ())]


def test_every_class_has_an_example() -> None:
    assert {kind for kind in subclasses(errors.LgmpcError) if kind.__module__ == errors.__name__} <= set(EXAMPLES)


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
@pytest.mark.parametrize("kind", EXAMPLES, ids=lambda kind: kind.__name__)
def test_an_exception_can_be_pickled(kind: type[BaseException], protocol: int) -> None:
    error = EXAMPLES[kind]
    assert facts(pickle.loads(pickle.dumps(error, protocol))) == facts(error)


def test_a_worker_process_returns_the_error_of_a_bad_config() -> None:
    with ProcessPoolExecutor(1, mp_context=get_context("forkserver")) as pool:
        first, second = pool.submit(parse_config, "name: x\nseed: -1\n"), pool.submit(pow, 2, 3)
        with pytest.raises(errors.ConfigErrors) as caught:
            first.result()
        assert [each.key for each in caught.value.problems] == ["robot", "seed"]
        assert second.result() == 8, "the pool is still usable"


def test_a_message_shortens_what_came() -> None:
    long = "x" * 50_000
    for error in (
        errors.InputError("mu", long, "a number"),
        errors.InputError(long, 1, long, [long] * 100),
        errors.ConfigErrors([errors.ConfigError("f.yaml", long, long, "a number")] * 1000),
        errors.ModelError(long, [long] * 1000),
        errors.CompileError("f", long, long),
        errors.RunFolderError(long),
    ):
        assert len(str(error)) <= errors.LONGEST_MESSAGE
    assert "... and 990 more" in str(errors.ModelError("arm", ["no mass"] * 1000))
    assert errors.shortened("abcdefghijklmnop", 11) == "abc ... nop"


def test_terminals_take_no_character_of_a_message_for_a_command() -> None:
    error = errors.ConfigError("f\x9b.yaml", "a\x1b[31m", "\x07\r\nb", "tables\nof keys", ["\u202ea"])
    text = "f\\x9b.yaml: a\\x1b[31m: got \\x07\\r\\nb; expected tables\nof keys. Valid: \\u202ea"
    assert str(error) == text
    assert error.key == "a\x1b[31m", "attributes are as they came"
    assert str(errors.RunFolderError("caf\u00e9 \udcff")) == "caf\u00e9 \udcff", "bytes of a path stay"
