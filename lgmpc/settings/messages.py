"""Messages for pydantic's errors: the key, the value received, the values expected, and the valid choices."""

import difflib
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from lgmpc.errors import InputError
from lgmpc.settings import PROBLEM, Problem, Settings, Words

_EXPECTED = {
    "bool_type": "true or false",
    "dict_type": "a table {{key: value}}",
    "finite_number": "a finite number",
    "float_type": "a number",
    "float_parsing": "a number",
    "greater_than": "a number greater than {gt:g}",
    "greater_than_equal": "a number not below {ge:g}",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "less_than": "a number less than {lt:g}",
    "less_than_equal": "a number not above {le:g}",
    "model_type": "a table of keys",
    "model_attributes_type": "a table of keys",
    "path_type": "a path",
    "string_pattern_mismatch": "letters, digits, '.', '_' and '-' only",
    "string_too_long": "at most {max_length} characters",
    "string_too_short": "some text",
    "string_type": "text",
    "too_short": "at least {min_length} of them",
    "tuple_type": "a list",
}


@dataclass(frozen=True)
class Finding:
    """One key that cannot be used; the fields are the arguments of :class:`lgmpc.errors.InputError`.

    Attributes:
        key: dotted path from the validated root.
        got: the value received, in words.
        expected: the values accepted, in words.
        choices: the valid keys or values, if they can be listed.
        word: what the choices are compared with to find the nearest; ``got`` if None.
    """

    key: str
    got: str
    expected: str
    choices: tuple[str, ...] = ()
    word: str | None = None


def find_problems(error: ValidationError, root: type[Settings], data: Any) -> list[Finding]:
    """Translate pydantic's errors.

    Args:
        error: raised by pydantic.
        root: the class that was validated.
        data: the plain data that was validated.
    """
    return [each for detail in error.errors(include_url=False) for each in _translate(detail, root, data)]


def first_input_error(error: ValidationError, root: type[Settings], data: Any) -> InputError:
    """Return the first problem as the error of an argument."""
    first = find_problems(error, root, data)[0]
    return InputError(first.key, first.got, first.expected, first.choices, word=first.word)


def show_value(value: Any) -> str:
    """Return ``value`` in words, shortened."""
    if value is None:
        return "nothing (null)"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return "NaN (.nan)" if math.isnan(value) else f"{value:g}"
    if isinstance(value, Words):
        return str(value)
    if isinstance(value, str):
        return f"the text '{_shorten(value)}'"
    if isinstance(value, Mapping):
        return "the table {" + _shorten(", ".join(map(str, value))) + "}"
    if isinstance(value, (list, tuple)):
        return "the list [" + _shorten(", ".join(map(str, value))) + "]"
    return _shorten(str(value))


def _shorten(text: str, length: int = 60) -> str:
    return text if len(text) <= length else text[: length - 3] + "..."


def _translate(detail: ErrorDetails, root: type[Settings], data: Any) -> Iterator[Finding]:
    kind = detail["type"]
    path = _path_in_data(detail["loc"], data, missing=kind == "missing")
    key = ".".join(path)
    context = detail.get("ctx", {})
    if kind == PROBLEM:
        each: Problem
        for each in context["problems"]:
            inner = ".".join(part for part in (key, each.key) if part)
            got = each.got if each.key else detail["input"]
            yield Finding(inner, show_value(got), each.expected)
        return
    if kind == "extra_forbidden":
        yield _unknown_key(path, detail["input"], root, data)
        return
    if kind == "missing":
        about = _description(root, path, data)
        yield Finding(key, "nothing", f"a value{about}")
        return
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        field = _field(root, path, data)
        branches = list(_sections_of(field.annotation)) if field else []
        tags = list(dict.fromkeys(tag for branch in branches for tag in _kinds(branch)))
        key = f"{key}.{_tag_key(branches[0]) if branches else 'kind'}"
        got = context.get("tag")
        yield Finding(key, show_value(got), f"one of {', '.join(tags)}", tuple(tags) if got else (), word=str(got))
        return
    choices = re.findall(r"'([^']*)'", context["expected"]) if kind == "literal_error" else []
    words = f"one of {', '.join(choices)}" if choices else _words(kind, context, detail["msg"])
    got = detail["input"]
    yield Finding(key, show_value(got), words + _description(root, path, data), tuple(choices), word=str(got))


def _words(kind: str, context: Mapping[str, Any], message: str) -> str:
    pattern = _EXPECTED.get(kind)
    if pattern is None:
        return message[:1].lower() + message[1:]
    return pattern.format(**context)


def _path_in_data(loc: Sequence[int | str], data: Any, *, missing: bool) -> list[str]:
    """Remove from ``loc`` pydantic's names of union branches, which are not keys of the data."""
    path: list[str] = []
    here = data
    for depth, part in enumerate(loc):
        absent = missing and depth == len(loc) - 1
        if isinstance(here, Mapping):
            if part in here:
                here = here[part]
            elif not absent:
                continue
        elif isinstance(here, (list, tuple)) and isinstance(part, int):
            here = here[part] if part < len(here) else None
        else:
            continue
        path.append(str(part))
    return path


def _unknown_key(path: list[str], got: Any, root: type[Settings], data: Any) -> Finding:
    """Return the nearest key of the same section or, if none is similar, the same key of other sections."""
    *outer, word = path
    section = _section(root, outer, data)
    known = list(section.model_fields) if section else []
    near = difflib.get_close_matches(word, known, n=3, cutoff=0.5)
    own = _tags_with(root, path, data)
    if own is not None:
        chooser, tags, chosen = own
        got = f"a key that only {chooser} = {' or '.join(tags)} has (value {show_value(got)})"
        key, where = ".".join(path), f"a key of {'.'.join(outer)} for {chooser} = {chosen}"
        return Finding(key, got, where)
    elsewhere = [each for each in _all_keys(root) if each.rpartition(".")[2] == word]
    if elsewhere and not difflib.get_close_matches(word, known, cutoff=0.75):
        choices = elsewhere
    else:
        choices = [".".join([*outer, each]) for each in near or known]
    key = ".".join(path)
    where = f"a key of {'.'.join(outer)}" if outer else "a key of a config"
    return Finding(key, f"an unknown key (value {show_value(got)})", where, tuple(choices), word=key)


def _tags_with(root: type[Settings], path: list[str], data: Any) -> tuple[str, list[str], str] | None:
    """Return, if other branches of a union have a key, the key that selects branches, their tags, and the given tag."""
    for depth in range(1, len(path)):
        parent = _section(root, path[: depth - 1], data)
        if parent is None or path[depth - 1] not in parent.model_fields:
            return None
        branches = list(_sections_of(parent.model_fields[path[depth - 1]].annotation))
        rest = ".".join(path[depth:])
        tags = [tag for each in branches if rest in _all_keys(each) for tag in _kinds(each)]
        if len(branches) > 1 and tags:
            here = data
            for part in path[:depth]:
                here = here[int(part) if isinstance(here, (list, tuple)) else part]
            chosen = _kinds(_branch(branches, here))[0]
            return f"{'.'.join(path[:depth])}.{_tag_key(branches[0])}", tags, chosen
    return None


def _all_keys(section: type[Settings], prefix: str = "") -> Iterator[str]:
    for name, info in section.model_fields.items():
        yield prefix + name
        for inner in _sections_of(info.annotation):
            yield from _all_keys(inner, f"{prefix}{name}.")


def _description(root: type[Settings], path: list[str], data: Any) -> str:
    info = _field(root, path, data)
    return f" ({info.description.rstrip('.')})" if info and info.description else ""


def _field(root: type[Settings], path: list[str], data: Any) -> FieldInfo | None:
    """Return the field at ``path``, or the nearest field around it (for a number in a list or table)."""
    for end in range(len(path), 0, -1):
        section = _section(root, path[: end - 1], data)
        if section is not None and path[end - 1] in section.model_fields:
            return section.model_fields[path[end - 1]]
    return None


def _section(root: type[Settings], path: Sequence[str], data: Any) -> type[Settings] | None:
    """Return the model that validates the table at ``path``."""
    section: type[Settings] = root
    here = data
    inside: list[type[Settings]] = [root]
    for part in path:
        if isinstance(here, (list, tuple)) and part.isdecimal():
            here = here[int(part)] if int(part) < len(here) else None
        else:
            if part not in section.model_fields:
                return None
            inside = list(_sections_of(section.model_fields[part].annotation))
            here = here.get(part) if isinstance(here, Mapping) else None
        if not inside:
            return None
        section = _branch(inside, here)
    return section


def _branch(sections: Sequence[type[Settings]], data: Any) -> type[Settings]:
    """Return the section of a union that its distinguishing key selects."""
    if len(sections) > 1 and isinstance(data, Mapping):
        for section in sections:
            if data.get(_tag_key(section)) in _kinds(section):
                return section
    return sections[0]


def _tag_key(section: type[Settings]) -> str:
    """Return the key whose value selects this section in a union."""
    return next((key for key in ("kind", "model", "method") if key in section.model_fields), "kind")


def _kinds(section: type[Settings]) -> tuple[str, ...]:
    """Return the values of that key that select this section."""
    field = section.model_fields.get(_tag_key(section))
    return get_args(field.annotation) if field else ()


def _sections_of(annotation: Any) -> Iterator[type[Settings]]:
    """Return the sections in an annotation such as ``Settings | None`` or ``tuple[Settings, ...]``."""
    origin = get_origin(annotation)  # in Python 3.10 dict[str, float] counts as a type, which issubclass refuses
    if origin is None and isinstance(annotation, type) and issubclass(annotation, Settings):
        yield annotation
    elif origin in (Union, UnionType, tuple, list):
        for inner in get_args(annotation):
            yield from _sections_of(inner)
    elif origin is Annotated:
        yield from _sections_of(get_args(annotation)[0])
