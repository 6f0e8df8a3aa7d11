"""The groups under test, and a grid of angles at which implementations of Lie groups fail."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import expm

from lgmpc.lie import se3, sek3, so3
from lgmpc.lie.coefficients import SEAM
from lgmpc.lie.symbolic import se3 as se3_symbolic, sek3 as sek3_symbolic, so3 as so3_symbolic

ATAN_SEAM_ANGLE = 2.0 * math.atan(0.2)
ANGLES = (0.0, 1e-12, 1e-8, 1e-4, ATAN_SEAM_ANGLE - 1e-9, ATAN_SEAM_ANGLE + 1e-9, 1.0, math.pi - 1e-6, math.pi)
BEYOND_PI = (math.sqrt(SEAM) - 1e-9, math.sqrt(SEAM) + 1e-9, 5.0)
LENGTHS = (0.0, 1.0, 3.0)


@dataclass(frozen=True, eq=False)
class Case:
    """A group with the properties that the tests use.

    Attributes:
        name: for the test's id.
        group: the numpy module.
        symbolic: its CasADi counterpart.
        dim: dimension of the tangent space.
        size: rows of an element.
        ambient: length of the vectors it acts on.
        angular: the entries of the rotation vector in the tangent.
    """

    name: str
    group: Any
    symbolic: ModuleType
    dim: int
    size: int
    ambient: int
    angular: slice

    def tangent(self, angle: float, length: float, seed: int = 0) -> np.ndarray:
        """A tangent vector with rotation by ``angle`` and other parts of norm ``length``, in random directions."""
        rng = np.random.default_rng([seed, self.dim])
        xi = rng.normal(size=self.dim).reshape(-1, 3)
        xi /= np.linalg.norm(xi, axis=1, keepdims=True)
        scale = np.full(self.dim // 3, length)
        scale[self.angular.start // 3] = angle
        return (xi * scale[:, None]).ravel()

    def tangents(self, angle: float) -> list[np.ndarray]:
        """Tangent vectors with a rotation by ``angle``, one for each length of the other parts, if there are any."""
        return [self.tangent(angle, length) for length in (LENGTHS if self.dim > 3 else LENGTHS[:1])]

    def random(self, seed: int) -> np.ndarray:
        """A random element, without the code under test."""
        return expm(self.hat(self.tangent(2.0, 1.5, seed)))

    def hat(self, xi: np.ndarray) -> np.ndarray:
        """The matrix of the algebra, written independently."""
        result = np.zeros((self.size, self.size))
        x, y, z = xi[self.angular]
        result[:3, :3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
        rest = np.delete(xi, np.r_[self.angular])
        result[:3, 3:] = rest.reshape(-1, 3).T
        return result

    def generators(self) -> list[np.ndarray]:
        return [self.hat(e) for e in np.eye(self.dim)]

    def function(self, name: str, symbol: type) -> ca.Function:
        """The CasADi counterpart of a function of one tangent vector."""
        return _function(self, name, symbol)


@functools.lru_cache
def _function(case: Case, name: str, symbol: type) -> ca.Function:
    xi = symbol.sym("xi", case.dim)
    return ca.Function(name, [xi], [getattr(case.symbolic, name)(xi)])


def _sek3(k: int) -> Case:
    return Case(f"SE_{k}(3)", sek3, sek3_symbolic, 3 + 3 * k, 3 + k, 3 + k, slice(0, 3))


CASES = (
    Case("SO(3)", so3, so3_symbolic, 3, 3, 3, slice(0, 3)),
    Case("SE(3)", se3, se3_symbolic, 6, 4, 3, slice(3, 6)),
    *(_sek3(k) for k in (1, 2, 4)),
)


@pytest.fixture
def cases() -> tuple[Case, ...]:
    return CASES


@pytest.fixture(params=CASES, ids=lambda case: case.name)
def case(request: pytest.FixtureRequest) -> Case:
    return request.param


@pytest.fixture(params=ANGLES, ids=lambda angle: f"angle={angle:.10g}")
def angle(request: pytest.FixtureRequest) -> float:
    """Rotation angles up to pi, rad."""
    return request.param


@pytest.fixture(params=[*ANGLES, *BEYOND_PI], ids=lambda angle: f"angle={angle:.10g}")
def any_angle(request: pytest.FixtureRequest) -> float:
    """Rotation angles on both sides of pi, rad."""
    return request.param


@pytest.fixture(params=LENGTHS, ids=lambda length: f"length={length:g}")
def length(request: pytest.FixtureRequest) -> float:
    """Norms of the translation parts, m."""
    return request.param
