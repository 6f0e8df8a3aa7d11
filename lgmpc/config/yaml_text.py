"""Reading and writing YAML: YAML 1.2's plain values, no duplicate keys, and the line of every key.

PyYAML follows YAML 1.1, where ``1e-3`` is a string, ``12:30`` is 750 and ``no`` is false. Here plain values are those
of YAML 1.2's core schema (https://yaml.org/spec/1.2.2/#103-core-schema).
"""

import re
import stat
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from lgmpc.errors import ConfigError, shortened

MOST_BYTES = 262_144
"""Largest size of a document: the shipped configs have at most 6 kB, and 256 kB are parsed in about 4 s."""

MOST_VALUES = 100_000
"""Largest number of values of a document, aliases expanded: the shipped configs have fewer than 200."""

_TYPES = (
    ("tag:yaml.org,2002:null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    ("tag:yaml.org,2002:bool", r"true|True|TRUE|false|False|FALSE", list("tTfF")),
    ("tag:yaml.org,2002:int", r"[-+]?[0-9]+", list("-+0123456789")),
    (
        "tag:yaml.org,2002:float",
        r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)",
        list("-+.0123456789"),
    ),
    ("tag:yaml.org,2002:merge", r"<<", ["<"]),
)


class _Loader(yaml.SafeLoader):
    """PyYAML's safe loader with the plain values of YAML 1.2."""

    yaml_implicit_resolvers: dict[Any, Any] = {}

    def __init__(self, text: str, name: str) -> None:
        super().__init__(text)
        self._file = name

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        """Return the value of a node; raise a ConfigError for a tag that does not allow it, such as ``!!int abc``."""
        try:
            return super().construct_object(node, deep)
        except ConfigError:
            raise
        except (ValueError, KeyError, AttributeError, IndexError) as error:
            tag = node.tag.replace("tag:yaml.org,2002:", "!!")
            got = f"{tag} {node.value}" if isinstance(node, yaml.ScalarNode) else tag
            place = f"{self._file}:{node.start_mark.line + 1}"
            raise ConfigError(place, "", got, f"a value that the tag {tag} allows") from error

    def construct_decimal(self, node: yaml.ScalarNode) -> int:
        """Return a whole number; a leading zero does not make it octal as in YAML 1.1."""
        return int(self.construct_scalar(node))


class _Dumper(yaml.SafeDumper):
    """Writes lists of plain values on one line, and quotes strings that YAML 1.1 or 1.2 would read as another type."""

    yaml_implicit_resolvers = {first: list(rules) for first, rules in yaml.SafeDumper.yaml_implicit_resolvers.items()}

    def represent_short_list(self, data: list[Any]) -> yaml.SequenceNode:
        """Represent a list, on one line if it contains no other list or table."""
        node = self.represent_list(data)
        node.flow_style = not any(isinstance(item, (list, dict)) for item in data)
        return node


for _tag, _pattern, _first in _TYPES:
    _Loader.add_implicit_resolver(_tag, re.compile(rf"^(?:{_pattern})$"), _first)
    _Dumper.add_implicit_resolver(_tag, re.compile(rf"^(?:{_pattern})$"), _first)
_Loader.add_constructor("tag:yaml.org,2002:int", _Loader.construct_decimal)
_Dumper.add_representer(list, _Dumper.represent_short_list)


def read_text(file: Path, expected: str = "a YAML file", choices: Sequence[str] = ()) -> str:
    """Return the text of a file, or of a pipe.

    Args:
        file: its path.
        expected: the files accepted, in words.
        choices: what could be meant where there is no such file, beside the YAML files of its folder.

    Raises:
        ConfigError: if it does not exist, cannot be read, is a folder or a device, is too large, or is not text.
    """
    try:
        mode = file.stat().st_mode
        if not (stat.S_ISREG(mode) or stat.S_ISFIFO(mode) or stat.S_ISDIR(mode)):
            raise ConfigError(str(file), "", "a device", expected)
        with file.open("rb") as stream:
            content = stream.read(MOST_BYTES + 1)
        if len(content) > MOST_BYTES:
            raise ConfigError(str(file), "", f"more than {MOST_BYTES} bytes", expected)
        return content.decode("utf-8")
    except FileNotFoundError as error:
        near = [*sorted(str(each) for each in file.parent.glob("*.y*ml")), *choices]
        raise ConfigError(str(file), "", "no such file", expected, near, word=str(file)) from error
    except IsADirectoryError as error:
        inside = sorted(str(each) for each in file.glob("*.yaml"))
        raise ConfigError(str(file), "", "a folder", expected, inside) from error
    except UnicodeDecodeError as error:
        raise ConfigError(str(file), "", f"a byte that is not UTF-8 text (at {error.start})", expected) from error
    except OSError as error:
        raise ConfigError(str(file), "", f"a file that cannot be read ({error.strerror})", expected) from error


def parse_yaml(text: str, name: str) -> tuple[Any, dict[str, str]]:
    """Parse one YAML document.

    Args:
        text: the document.
        name: the document's name in messages.

    Returns:
        The plain Python value, and for every dotted key its place as ``"name:line"``.

    Raises:
        ConfigError: at the line of a syntax error, a duplicate key, or a key that is not a name.
    """
    places: dict[str, str] = {}
    if len(text) > MOST_BYTES:
        raise ConfigError(name, "", f"{len(text)} characters", f"at most {MOST_BYTES}")
    try:
        loader = _Loader(text, name)
        node = loader.get_single_node()
        if node is None:
            return None, places
        _collect_places(node, name, "", places, ())
        return loader.construct_document(node), places
    except ConfigError:
        raise
    except yaml.MarkedYAMLError as error:
        raise _syntax_error(error, name) from error
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        raise ConfigError(f"{name}:{line}", "", f"the character U+{error.character:04X}", "printable text") from error
    except RecursionError as error:
        raise ConfigError(name, "", "lists or tables nested hundreds deep", "a config") from error


def parse_scalar(text: str, key: str, name: str) -> Any:
    """Parse the value of ``key`` as one line of YAML: a number, true, text, ``[0, 1]``, ``{a: 1}``.

    Raises:
        ConfigError: if it is not YAML.
    """
    try:
        return parse_yaml(text, name)[0]
    except ConfigError as error:
        raise ConfigError(
            name,
            key,
            shortened(text, 60),
            "a YAML value, such as 0.5, true, [0, 3, 0] (in quotes if your shell needs them)",
        ) from error


def write_yaml(data: Any) -> str:
    """Return ``data`` (tables, lists, numbers, text) as YAML that :func:`parse_yaml` reads back unchanged."""
    return yaml.dump(data, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=110)


def _collect_places(node: yaml.Node, name: str, path: str, places: dict[str, str], around: tuple[int, ...]) -> None:
    """Fill ``places`` below ``node``, aliases expanded; raise for nodes that a config must not contain.

    Args:
        node: of the document.
        name: the document's name in messages.
        path: dotted key of the node.
        places: dotted key to place.
        around: identities of the nodes that contain this one.
    """

    def visit(key: str, line: int, inner: yaml.Node) -> None:
        key = f"{path}.{key}" if path else key
        places[key] = f"{name}:{line}"
        if len(places) > MOST_VALUES:
            raise ConfigError(places[key], "", f"more than {MOST_VALUES} values, aliases expanded", "fewer")
        _collect_places(inner, name, key, places, (*around, id(node)))

    first_lines: dict[str, int] = {}
    if id(node) in around:
        raise ConfigError(f"{name}:{node.start_mark.line + 1}", "", "an alias of a node that contains it", "no loops")
    if isinstance(node, yaml.SequenceNode):
        for i, item in enumerate(node.value):
            visit(str(i), item.start_mark.line + 1, item)
    elif isinstance(node, yaml.MappingNode):
        for key_node, value_node in node.value:
            line, word = key_node.start_mark.line + 1, key_node.value
            if key_node.tag != "tag:yaml.org,2002:merge":
                if key_node.tag != "tag:yaml.org,2002:str":
                    got = f"the key {word}" if isinstance(key_node, yaml.ScalarNode) else "a list or table as key"
                    expected = "a name as a key (in quotes if it looks like a number)"
                    raise ConfigError(f"{name}:{line}", path, got, expected)
                if word in first_lines:
                    expected = f"each key once (first in line {first_lines[word]})"
                    key = f"{path}.{word}" if path else word
                    raise ConfigError(f"{name}:{line}", key, "the key a second time", expected)
                first_lines[word] = line
            visit(word, line, value_node)


def _syntax_error(error: yaml.MarkedYAMLError, name: str) -> ConfigError:
    mark = error.problem_mark or error.context_mark
    detail = ", ".join(part for part in (error.problem, error.context) if part)
    if "'\\t'" in detail:
        detail = "a tab, where YAML is indented by spaces"
    if mark is None:
        return ConfigError(name, "", f"broken YAML ({detail})", "valid YAML")
    snippet = mark.get_snippet(indent=4, max_length=90) or ""
    excerpt = f"\n{snippet}" if snippet.strip(" ^\n") else ""  # empty at the end of the text
    return ConfigError(f"{name}:{mark.line + 1}", "", f"broken YAML ({detail})", f"valid YAML{excerpt}")
