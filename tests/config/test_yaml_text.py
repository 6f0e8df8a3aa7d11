"""YAML: plain values of YAML 1.2, places of keys, and malformed texts."""

import math

import pytest
import yaml
from hypothesis import given, strategies as st

from lgmpc.config.yaml_text import parse_scalar, parse_yaml, write_yaml
from lgmpc.errors import ConfigError


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-3", 1e-3),
        ("1E3", 1000.0),
        ("3.6e-4", 3.6e-4),
        ("1.", 1.0),
        (".5", 0.5),
        ("-.inf", -math.inf),
        ("012", 12),
        ("12:30", "12:30"),
        ("no", "no"),
        ("on", "on"),
        ("True", True),
        ("~", None),
        ("", None),
        ("1_000", "1_000"),
        ("2026-01-01", "2026-01-01"),
        ("[0, 3, 0]", [0, 3, 0]),
        ("{a: 1}", {"a": 1}),
    ],
)
def test_plain_values_mean_what_yaml_1_2_says(text: str, value: object) -> None:
    got = parse_yaml(f"x: {text}", "f.yaml")[0]["x"]
    assert got == value and type(got) is type(value)


def test_nan_is_read_as_a_number() -> None:
    assert math.isnan(parse_yaml("x: .nan", "f.yaml")[0]["x"])


def test_every_key_has_its_line() -> None:
    _, places = parse_yaml("a: 1\nb:\n  c: 2\n  d: [5, {e: 6}]\n", "f.yaml")
    assert places == {
        "a": "f.yaml:1",
        "b": "f.yaml:2",
        "b.c": "f.yaml:3",
        "b.d": "f.yaml:4",
        "b.d.0": "f.yaml:4",
        "b.d.1": "f.yaml:4",
        "b.d.1.e": "f.yaml:4",
    }


def test_merge_keys_and_anchors_work() -> None:
    data, _ = parse_yaml("a: &a {x: 1, y: 2}\nb: {<<: *a, y: 3}\n", "f.yaml")
    assert data["b"] == {"x": 1, "y": 3}


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("a: [1,\nb: 2", 2, "broken YAML"),
        ("a: 1\n\tb: 2", 2, "a tab"),
        ("a: b: c", 1, "mapping values are not allowed"),
        ("a: 'x\nb: 1\n", 3, "end of stream"),
        ("a: *x", 1, "undefined alias 'x'"),
        ("a: 1\nb: 2\na: 3", 3, "first in line 1"),
        ("a:\n  b: 1\n  b: 2", 3, "a.b: got the key a second time"),
        ("1: 2", 1, "the key 1"),
        ("? [1]\n: 2", 1, "a list or table as key"),
        ("- &x [*x]", 1, "an alias of a node that contains it"),
        ("a: !!python/object/apply:os.system [ls]", 1, "tag"),
        ("ok: 1\nbad: \x00", 2, "U+0000"),
        ("--- 1\n--- 2", 2, "another document"),
    ],
)
def test_broken_text_names_its_line(text: str, line: int, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_yaml(text, "f.yaml")
    assert str(caught.value).startswith(f"f.yaml:{line}:")
    assert words in str(caught.value)
    assert all(row.strip() for row in str(caught.value).splitlines())


@pytest.mark.parametrize("value", ["!!int abc", "!!bool maybe", "!!timestamp soon", "!!float ''"])
def test_a_tag_on_a_value_of_another_type_is_a_config_error(value: str) -> None:
    tag = value.partition(" ")[0]
    with pytest.raises(ConfigError, match=rf"f\.yaml:2: got {tag} .*; expected a value that the tag {tag} allows"):
        parse_yaml(f"b: 1\na: {value}", "f.yaml")


def test_the_size_of_a_text_is_refused_before_it_is_parsed() -> None:
    with pytest.raises(ConfigError, match=r"^f\.yaml: got 2000000 characters; expected at most 262144$"):
        parse_yaml("a: 1\n" * 400_000, "f.yaml")


def tower(levels: int, merged: bool) -> str:
    """A document of ``levels`` lines, each with nine aliases of the line before."""
    line = "a{}: &a{} {{<<: [{}]}}" if merged else "a{}: &a{} [{}]"
    first = "a0: &a0 {x: 1}" if merged else "a0: &a0 [1]"
    return "\n".join([first, *(line.format(k, k, ", ".join([f"*a{k - 1}"] * 9)) for k in range(1, levels))])


@pytest.mark.parametrize("merged", [False, True], ids=["lists", "merge keys"])
def test_nested_aliases_are_counted_before_they_are_expanded(merged: bool) -> None:
    with pytest.raises(ConfigError, match=r"^f\.yaml:\d: got more than 100000 values, aliases expanded"):
        parse_yaml(tower(200, merged), "f.yaml")
    data, _ = parse_yaml(tower(4, merged), "f.yaml")
    assert data["a3"] == ({"x": 1} if merged else [[[[1]] * 9] * 9] * 9)


@pytest.mark.parametrize("text", ["a: &a {<<: *a}", "a: &a {b: {<<: [*a]}}"])
def test_a_table_cannot_be_merged_into_itself(text: str) -> None:
    with pytest.raises(ConfigError, match="f.yaml:1: got an alias of a node that contains it"):
        parse_yaml(text, "f.yaml")


@pytest.mark.parametrize("text", ["a: !!int abc", "[" * 3000])
def test_text_that_breaks_the_parser_is_a_config_error(text: str) -> None:
    with pytest.raises(ConfigError, match=r"^f\.yaml"):
        parse_yaml(text, "f.yaml")


def test_a_broken_value_on_the_command_line_names_its_key() -> None:
    with pytest.raises(ConfigError, match=r"--set: mpc\.rate_hz: got \[1; expected a YAML value"):
        parse_scalar("[1", "mpc.rate_hz", "--set")


names = st.from_regex(r"[A-Za-z_*?][A-Za-z0-9_*?.-]{0,8}", fullmatch=True)
scalars = (
    st.none()
    | st.booleans()
    | st.integers(-(10**12), 10**12)
    | st.floats(allow_nan=False)
    | st.text(st.characters(codec="utf-8", exclude_categories=("Cs", "Cc")), max_size=12)
    | st.sampled_from(["1e-3", "12:30", "no", "null", "~", "1.0", "0x1", "<<", "2026-01-01", "-", "1_0"])
)
data = st.dictionaries(
    names, st.recursive(scalars, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(names, inner, max_size=3))
)


@given(data)
def test_written_data_are_read_back(value: dict[str, object]) -> None:
    text = write_yaml(value)
    assert parse_yaml(text, "f.yaml")[0] == value
    assert yaml.safe_load(text) == value, "readers of YAML 1.1 see the same"
