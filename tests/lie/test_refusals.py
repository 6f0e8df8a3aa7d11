"""Input that public functions reject, the messages, and ``unchecked`` without validation."""

from __future__ import annotations

import inspect

import numpy as np
import pytest

from lgmpc.errors import InputError
from lgmpc.lie import quaternion, se3, sek3, so3

EYE = np.eye(3)
REFLECTION = np.diag([1.0, 1.0, -1.0])
STRETCHED = EYE * 1.001
POSE = np.eye(5)


def with_entry(array: np.ndarray, value: float, index: tuple[int, ...] = (0, 0)) -> np.ndarray:
    changed = array.copy()
    changed[index] = value
    return changed


@pytest.mark.parametrize(
    ("function", "arguments", "message"),
    [
        (so3.exp, ([1.0, 2.0],), r"phi: got shape \(2,\); expected shape \(\.\.\., 3\)"),
        (so3.exp, (1.0,), r"phi: got shape \(\)"),
        (so3.exp, ([0.0, np.nan, 0.0],), "phi: got .*nan.*; expected finite"),
        (so3.left_jacobian, ([np.inf, 0.0, 0.0],), "phi: got .*inf.*; expected finite"),
        (so3.exp, ([1e200, 0.0, 0.0],), "smaller than 1e100"),
        (so3.exp, (["a", "b", "c"],), "real numbers"),
        (so3.exp, ([1j, 0.0, 0.0],), "real numbers"),
        (so3.exp, ([[1.0, 2.0, 3.0], [1.0]],), "real numbers"),
        (so3.exp, (None,), "real numbers"),
        (so3.log, (STRETCHED,), r"rotation: got a matrix R with \|R\^T R - I\| = 0.002.*so3.project"),
        (so3.log, (REFLECTION,), "rotation: got a reflection"),
        (so3.log, (with_entry(EYE, np.nan),), "rotation: .*finite"),
        (so3.log, (np.zeros((3, 3)),), "orthonormal"),
        (so3.log, (np.eye(4),), r"rotation: got shape \(4, 4\); expected shape \(\.\.\., 3, 3\)"),
        (so3.compose, (EYE, STRETCHED), "second: got a matrix R"),
        (so3.act, (STRETCHED, [0.0, 0.0, 1.0]), "rotation: got a matrix R"),
        (so3.vee, (EYE,), "skew"),
        (so3.to_quaternion, (REFLECTION,), "reflection"),
        (quaternion.log, ([0.0, 0.0, 0.0, 1.01],), "q: got norm 1.01; expected norm 1"),
        (quaternion.to_matrix, ([0.0, 0.0, 0.0, 0.0],), "q: got norm 0"),
        (quaternion.to_matrix, ([0.0, 0.0, 1.0],), "x y z w"),
        (quaternion.compose, ([0.0, 0.0, 0.0, 1.0], [0.0, 0.0, np.nan, 1.0]), "second: .*finite"),
        (se3.exp, (np.zeros(7),), r"xi: got shape \(7,\)"),
        (se3.log, (with_entry(np.eye(4), 0.1, (3, 0)),), "pose: got bottom rows"),
        (se3.log, (with_entry(np.eye(4), 1.1),), "pose: got a matrix R"),
        (se3.inverse, (with_entry(np.eye(4), np.inf, (0, 3)),), "pose: .*finite"),
        (se3.vee, (np.eye(4),), "skew"),
        (se3.vee, (with_entry(np.zeros((4, 4)), 1.0, (3, 3)),), "bottom rows of zeros"),
        (se3.from_parts, (STRETCHED, np.zeros(3)), "rotation"),
        (sek3.exp, (np.zeros(3),), r"shape \(\.\.\., 3 \+ 3 k\)"),
        (sek3.exp, (np.zeros(8),), r"shape \(\.\.\., 3 \+ 3 k\)"),
        (sek3.log, (EYE,), r"shape \(\.\.\., 3 \+ k, 3 \+ k\)"),
        (sek3.log, (with_entry(POSE, 0.5, (3, 4)),), "pose: got bottom rows"),
        (sek3.vee, (with_entry(np.zeros((5, 5)), 1.0, (4, 4)),), "bottom rows of zeros"),
        (sek3.compose, (np.eye(5), np.eye(6)), r"compose: got first \(5, 5\), second \(6, 6\)"),
        (sek3.act, (np.eye(5), np.ones(4)), r"act: got pose \(5, 5\), vector \(4,\)"),
        (sek3.act, (np.eye(5), 1.0), "vector: got shape"),
        (sek3.identity, (0,), "k: got 0"),
        (sek3.identity, (1.5,), "k: got 1.5"),
        (sek3.identity, (None,), "k: got None"),
        (so3.compose, (np.tile(EYE, (2, 1, 1)), np.tile(EYE, (3, 1, 1))), "broadcast"),
    ],
)
def test_bad_input_is_named(function, arguments, message) -> None:
    with pytest.raises(InputError, match=message):
        function(*arguments)


@pytest.mark.parametrize(
    ("function", "distorted"),
    [
        (so3.inverse, lambda e: np.sqrt(1.0 + e) * EYE),
        (so3.inverse, lambda e: EYE + e * np.eye(3, k=1)),
        (quaternion.inverse, lambda e: (1.0 + e) * quaternion.identity()),
        (se3.inverse, lambda e: np.eye(4) + e * np.eye(4, k=-3)),
        (so3.vee, lambda e: e * EYE / 2.0),
        (se3.vee, lambda e: e * np.eye(4, k=-3)),
    ],
)
def test_errors_up_to_a_millionth_are_accepted_as_rounding(function, distorted) -> None:
    for size in (0.9e-6, -0.9e-6):
        function(distorted(size))
    for size in (1.1e-6, -1.1e-6):
        with pytest.raises(InputError):
            function(distorted(size))


def test_entries_are_accepted_up_to_1e100() -> None:
    assert np.isfinite(so3.hat([0.99e100, 0.0, 0.0])).all()
    with pytest.raises(InputError, match="smaller than 1e100"):
        so3.hat([1e100, 0.0, 0.0])


def test_one_bad_element_of_a_batch_is_enough() -> None:
    batch = np.tile(EYE, (4, 1, 1))
    so3.log(batch)
    batch[2] = REFLECTION
    with pytest.raises(InputError, match="reflection"):
        so3.log(batch)
    batch[2] = STRETCHED
    with pytest.raises(InputError, match="orthonormal"):
        so3.log(batch)


def test_every_public_function_of_arrays_refuses_nan() -> None:
    """All of them, without exception."""
    for module in (so3, se3, sek3, quaternion):
        for name, function in vars(module).items():
            imported = inspect.ismodule(module) and getattr(function, "__module__", "") != module.__name__
            if name == "identity" or name.startswith("_") or imported:
                continue
            parameters = len(inspect.signature(function).parameters)
            with pytest.raises(InputError):
                function(*[np.full((4, 4), np.nan)] * parameters)


def test_lists_integers_and_rounding_errors_are_accepted() -> None:
    assert np.array_equal(so3.exp([0, 0, 0]), EYE)
    assert so3.exp(phi=[0, 0, 1]).shape == (3, 3)
    so3.log(so3.exp([0.3, 0.2, 0.1]) + 1e-8)
    quaternion.log([0.0, 0.0, 0.6, 0.8 + 1e-8])
    se3.log(np.linalg.inv(se3.exp(np.arange(6.0))))


def test_unchecked_does_not_validate() -> None:
    assert np.isnan(so3.exp.unchecked(np.full(3, np.nan))).any()
    phi = np.array([0.1, 0.2, 0.3])
    assert np.array_equal(so3.exp.unchecked(phi), so3.exp(phi))


def test_results_never_alias_arguments() -> None:
    rotation, placement, xi = so3.exp([0.1, 0.2, 0.3]), se3.exp(np.arange(6.0)), np.arange(6.0)
    for result, argument in (
        (so3.adjoint(rotation), rotation),
        (so3.inverse(rotation), rotation),
        (se3.inverse(placement), placement),
        (se3.vee(se3.hat(xi)), xi),
        (se3.coadjoint(xi), xi),
        (quaternion.canonical(quaternion.identity()), quaternion.identity()),
    ):
        assert not np.shares_memory(result, argument)
