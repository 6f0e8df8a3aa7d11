"""The base of every package's settings: constructed in Python, and changed."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
import pytest
from pydantic import Discriminator, Field, ValidationError

from lgmpc.errors import InputError
from lgmpc.settings import Positive, Settings, Vector3


class _Weights(Settings):
    com: Vector3 = (1.0, 1.0, 1.0)
    force: Positive = 1e-3


class _Small(Settings):
    kind: Literal["small"] = "small"
    size: Positive = 1.0


class _Large(Settings):
    kind: Literal["large"] = "large"
    weight_kg: Positive = 100.0


class _Mpc(Settings):
    node_s: Positive = Field(default=0.02, description="Length of an interval, s.")
    weights: _Weights = _Weights()
    points: tuple[Vector3, ...] = ((0.0, 0.0, 0.0),)
    body: Annotated[_Small | _Large, Discriminator("kind")] = _Small()


@pytest.mark.parametrize(
    ("given", "key", "words"),
    [
        ({"node_s": -1.0}, "node_s", "a number greater than 0 (Length of an interval, s)"),
        ({"node_s": "fast"}, "node_s", "a number"),
        ({"nod_s": 1.0}, "nod_s", "Did you mean node_s?"),
        ({"weights": {"force": 0.0}}, "weights.force", "greater than 0"),
        ({"weights": {"com": (1.0, 2.0)}}, "weights.com", "three numbers"),
    ],
)
def test_bad_values_raise_an_input_error_that_names_the_key(given: dict[str, object], key: str, words: str) -> None:
    with pytest.raises(InputError, match=key) as caught:
        _Mpc(**given)  # type: ignore[arg-type]
    assert caught.value.argument == key
    assert words in str(caught.value)


def test_a_document_collects_every_problem() -> None:
    with pytest.raises(ValidationError) as caught:
        _Mpc.model_validate({"node_s": -1.0, "weights": {"force": 0.0}})
    assert caught.value.error_count() == 2


def test_replace_changes_nested_values_and_leaves_the_original() -> None:
    settings = _Mpc(weights=_Weights(force=2e-3))
    changed = settings.replace({"weights.com": (1.0, 2.0, 3.0), "node_s": 0.01, "points.0": (1.0, 0.0, 0.0)})
    assert changed.weights == _Weights(com=(1.0, 2.0, 3.0), force=2e-3)
    assert (changed.node_s, changed.points) == (0.01, ((1.0, 0.0, 0.0),))
    assert settings == _Mpc(weights=_Weights(force=2e-3))


def test_numbers_and_arrays_of_numpy_are_values() -> None:
    mpc = _Mpc(points=np.ones((2, 3))).replace({"node_s": np.float32(0.5), "weights.com": np.arange(3.0)})
    assert (mpc.points, mpc.node_s, mpc.weights.com) == (((1.0,) * 3,) * 2, 0.5, (0.0, 1.0, 2.0))
    assert type(mpc.node_s) is float
    with pytest.raises(InputError, match=r"node_s: got the list .*; expected a number"):
        mpc.replace({"node_s": np.ones(2)})


def test_replace_within_default_settings_keeps_the_other_defaults() -> None:
    class Gain(Settings):
        kp: Positive
        kd: Positive | None = None

    class Gains(Settings):
        com: Gain = Gain(kp=100.0)

    assert Gains().replace({"com.kd": 1.0}).com == Gain(kp=100.0, kd=1.0)


def test_replace_keeps_a_variant_that_was_given() -> None:
    assert _Mpc(body=_Large()).replace({"body.weight_kg": 2.0}).body == _Large(weight_kg=2.0)


def test_replace_of_a_variant_brings_its_defaults() -> None:
    assert _Mpc(body=_Small()).replace({"body": {"kind": "large"}}).body == _Large()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"node_s": 0.0}, "greater than 0"),
        ({"weights.forces": 1.0}, "Did you mean weights.force?"),
        ({"node_s.value": 1.0}, "a plain value"),
        ({"points.3": (0.0, 0.0, 0.0)}, "a position from 0 to 1"),
    ],
)
def test_replace_validates(changes: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match="expected") as caught:
        _Mpc(node_s=0.02, points=((0.0, 0.0, 0.0),)).replace(changes)
    assert words in str(caught.value)
