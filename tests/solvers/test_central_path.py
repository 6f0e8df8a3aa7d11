"""The interior point method of ``central_path.c``, against Newton's method on dense optimality conditions."""

from __future__ import annotations

import numpy as np

from lgmpc.compile import frame_of
from lgmpc.solvers.qp.active_set import row_methods


class CentralPath:
    """The calls on memory of the test's own."""

    def __init__(self, *arrays: np.ndarray) -> None:  # lower, upper, rows, weights, targets, known
        lower, upper, rows, weights, targets, known = arrays
        library = row_methods()
        assert library is not None
        self._numbers, self.point, self.multipliers, self._measures = (
            np.zeros(size) for size in (2, *[rows.shape] * 2, 3)
        )
        plan, count = np.array([*rows.shape, rows.shape[1]]), np.zeros(1, dtype=np.int64)
        self._frame = frame_of(
            plan, self._numbers, lower, upper, known, rows, weights, targets, np.zeros(rows.shape),
            np.zeros((*rows.shape, 2, 9)), count, self.point, self.multipliers, self._measures,
        )  # fmt: skip
        self._library = library

    def begin(self, start: float, penalty: float) -> None:
        """Begin with these penalties of rows with an interior, and without."""
        self._numbers[:] = start, penalty
        self.call("begin")

    def call(self, name: str) -> np.ndarray:
        """Call a function; return the active bounds that changed, the active bounds, the length of the step."""
        self._library[f"lgmpc_path_{name}"](self._frame)
        return self._measures


def newton(
    hessian: np.ndarray, centre: np.ndarray, signs: np.ndarray, bounds: np.ndarray, s: np.ndarray, z: np.ndarray,
    target: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Rows r, and steps of slacks and multipliers, of ``h (r - c) + G^T z = 0, s = b - G r, s z = target``.

    G (signs, m x n) and b bound the rows from above, after a change of sign where they bound them from below.
    """
    n, m = centre.size, s.size
    kkt = np.block(
        [
            [np.diag(hessian), np.zeros((n, m)), signs.T],
            [signs, np.eye(m), np.zeros((m, m))],
            [np.zeros((m, n)), np.diag(z), np.diag(s)],
        ]
    )
    step = np.linalg.solve(kkt, np.concatenate([hessian * centre - signs.T @ z, bounds - s, target - s * z]))
    return step[:n], step[n : n + m], step[n + m :]


def longest(s: np.ndarray, ds: np.ndarray, z: np.ndarray, dz: np.ndarray) -> float:
    """The longest step, at most 1, that keeps slacks and multipliers from becoming negative."""
    ratios = [-value / step for value, step in zip(np.r_[s, z], np.r_[ds, dz], strict=True) if step < 0.0]
    return min([1.0, *ratios])


def test_steps_are_mehrotras() -> None:
    """Predictor, centring by the cube of what the predictor leaves, corrector of second order; six rows, ten bounds."""
    rng = np.random.default_rng(0)
    hessian, centre = rng.uniform(0.5, 3.0, (2, 3)), 2.0 * rng.standard_normal((2, 3))
    lower, upper = -rng.uniform(0.1, 1.0, (2, 3)), rng.uniform(0.1, 1.0, (2, 3))
    lower[0, 1], upper[1, 2] = -np.inf, np.inf
    low, high = np.flatnonzero(np.isfinite(lower)), np.flatnonzero(np.isfinite(upper))
    signs = np.vstack([-np.eye(6)[low], np.eye(6)[high]])
    bounds = np.concatenate([-lower.ravel()[low], upper.ravel()[high]])
    start = 0.7
    rows, weights, targets, known = np.zeros((4, 2, 3))
    known[0, 0], known[1, 1] = -5.0, 0.01
    path = CentralPath(lower, upper, rows, weights, targets, known)

    def minimise() -> None:
        """Minimise the cost ``1/2 h (row - c)^2`` with the penalties that the path has written."""
        rows[...] = (hessian * centre + weights * targets) / (hessian + weights)

    path.begin(start, 1e6)
    minimise()
    path.call("start")
    gap = bounds - signs @ rows.ravel()
    worst = -gap.min()
    s, z = np.maximum(gap, worst), start * (np.maximum(-gap, 0.0) + 0.3 * worst)
    z = np.maximum(z, signs @ known.ravel())  # known multipliers are where it begins, if they are large enough
    assert (z == 5.0).sum() == 1
    for _ in range(5):
        problem = hessian.ravel(), centre.ravel(), signs, bounds, s, z
        path.call("predict")
        minimise()
        predicted, ds, dz = newton(*problem, np.zeros(s.size))
        np.testing.assert_allclose(rows.ravel(), predicted, rtol=1e-9)
        path.call("correct")
        minimise()
        length = longest(s, ds, z, dz)
        left, mean = (s + length * ds) @ (z + length * dz) / s.size, s @ z / s.size
        corrected, ds, dz = newton(*problem, mean * (left / mean) ** 3 - ds * dz)
        np.testing.assert_allclose(rows.ravel(), corrected, rtol=1e-9)
        assert path.call("step")[2] > 1e-6
        length = min(1.0, 0.995 * longest(s, ds, z, dz))
        s, z = s + length * ds, z + length * dz
    assert path._measures[0] <= 0.02 * path._measures[1] and path._measures[2] > 0.8  # identified
    path.call("identify")
    np.testing.assert_allclose(path.point, np.clip(centre, lower, upper), atol=1e-4)
    np.testing.assert_allclose(path.multipliers, hessian * (centre - path.point), atol=1e-3)


def test_equal_bounds_alone_are_reached_without_slacks() -> None:
    centre, bound = np.array([[0.3, -2.0]]), np.array([[1.0, 0.5]])
    rows, weights, targets = np.zeros((3, 1, 2))
    path = CentralPath(bound, bound, rows, weights, targets, np.zeros((1, 2)))

    def minimise() -> None:
        rows[...] = (centre + weights * targets) / (1.0 + weights)

    path.begin(0.7, 1e3)
    minimise()
    path.call("start")
    for _ in range(5):
        path.call("predict")
        minimise()
        path.call("correct")
        minimise()
        assert path.call("step")[2] > 1e-6
    path.call("identify")
    np.testing.assert_array_equal(path.point, bound)
    np.testing.assert_allclose(rows, bound, atol=1e-10)
    np.testing.assert_allclose(path.multipliers, centre - bound, rtol=1e-9)
