"""Changes from the command line."""

from typing import Any

import pytest

from lgmpc.config.loading import apply_overrides, load_config, load_solve_config
from lgmpc.errors import ConfigError, InputError
from lgmpc.sweeps import load_sweep, run_sweep
from lgmpc.world import FloorSettings, SlopeSettings


def changed(*overrides: str) -> dict[str, Any]:
    data: dict[str, Any] = {"a": {"b": 1, "empty": None}, "list": [{"x": 1}, {"x": 2}], "plain": 3}
    apply_overrides(data, overrides)
    return data


@pytest.mark.parametrize(
    ("override", "path", "value"),
    [
        ("a.b=2.5", ("a", "b"), 2.5),
        ("a.b=[0, 3, 0]", ("a", "b"), [0, 3, 0]),
        ("a.b=true", ("a", "b"), True),
        ("a.b=", ("a", "b"), None),
        ("a.b=x=y", ("a", "b"), "x=y"),
        ("a.new.deep=1", ("a", "new", "deep"), 1),
        ("a.empty.deep=1", ("a", "empty", "deep"), 1),
        ("list.1.x=5", ("list", 1, "x"), 5),
        ("list.2={x: 3}", ("list", 2, "x"), 3),
        ("list.2.x=3", ("list", 2, "x"), 3),
        ("list=[]", ("list",), []),
        (" a.b =7", ("a", "b"), 7),
    ],
)
def test_a_change_is_applied(override: str, path: tuple[Any, ...], value: object) -> None:
    here: Any = changed(override)
    for part in path:
        here = here[part]
    assert here == value


def test_later_changes_apply_to_earlier_ones() -> None:
    assert changed("list=[]", "list.0={x: 9}", "list.0.x=8")["list"] == [{"x": 8}]


def test_places_are_those_of_the_last_change() -> None:
    data: dict[str, Any] = {}
    assert apply_overrides(data, ["a.b=1", "a={b: 2}"]) == {"a": "--set"}


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("a.b", "--set: got a.b; expected key=value"),
        ("", "--set: got nothing; expected key=value"),
        ("=3", "--set: got =3; expected key=value"),
        ("a..b=3", "--set: got a..b=3; expected key=value"),
        ("list.5.x=3", "--set: list.5: got position 5; expected a position from 0 to 2"),
        ("list.x=3", "--set: list.x: got position x"),
        ("list.-1=3", "--set: list.-1: got position -1"),
        ("plain.x=3", "--set: plain.x: got a key below plain = 3"),
        ("a.b=[1", "--set: a.b: got [1; expected a YAML value"),
    ],
)
def test_an_impossible_change_is_one_error_with_its_reason(override: str, message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        changed(override)
    assert str(caught.value).startswith(message)


@pytest.mark.parametrize("wrong", [None, "mpc.rate_hz=50", [50], {"mpc.rate_hz": 50}])
def test_changes_are_a_list_of_texts(wrong: Any) -> None:
    for load, name in ((load_config, "solo12_balance"), (load_solve_config, "solo12_jump"), (load_sweep, "push_map")):
        with pytest.raises(InputError, match="overrides: got .*; expected a list of changes key=value"):
            load(name, wrong)


def test_workers_of_a_sweep_are_a_number() -> None:
    with pytest.raises(InputError, match="workers: got 2; expected a int"):
        run_sweep("push_map", workers="2")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("overrides", "expected"),
    [
        (["world=slope"], SlopeSettings()),
        (["world=slope", "world.angle_deg=15"], SlopeSettings(angle_deg=15.0)),
        (["world={kind: slope, uphill_deg: 90}"], SlopeSettings(uphill_deg=90.0)),
        (["world.height_m=0.5"], FloorSettings(height_m=0.5)),
        (["world=floor"], FloorSettings()),
    ],
)
def test_the_name_of_a_ground_stands_for_its_section(overrides: list[str], expected: object) -> None:
    assert load_config("solo12_balance", overrides).world == expected


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (["world=slop"], "world.kind: got the text 'slop'; expected one of floor, slope, "),
        (["world.heigth_m=1"], "Did you mean world.height_m?"),
        (["world.angle_deg=5"], "a key that only world.kind = slope or ramp has"),
        (["world=slope", "world.angle_deg=50"], "world.angle_deg: got 50; expected a number not above 45"),
        (["world=3"], "world: got 3; expected a table of keys"),
    ],
)
def test_a_wrong_ground_is_one_error_with_the_nearest_choice(overrides: list[str], message: str) -> None:
    with pytest.raises(ConfigError) as raised:
        load_config("solo12_balance", overrides)
    assert message in str(raised.value)
