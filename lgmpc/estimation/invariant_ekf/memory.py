"""The filter's memory: one array for the state, views of it, checked copies into buffers."""

from __future__ import annotations

import math

import numpy as np

from lgmpc.errors import InputError
from lgmpc.typing import Array

__all__ = ["column_major", "read_only", "split_state", "write"]


def split_state(memory: Array, columns: int, size: int) -> tuple[Array, Array, Array]:
    """Return pose, biases and covariance as views of one array, so that one copy copies all."""
    pose, bias, covariance = np.split(memory, [columns**2, columns**2 + 6])
    return pose.reshape((columns, columns), order="F"), bias, covariance.reshape(size, size)


def column_major(matrix: Array) -> Array:
    """Return the flat memory of a matrix in column-major order."""
    return matrix.T.reshape(-1)


def read_only(array: Array) -> Array:
    """Return a view that cannot be written to."""
    view = array.view()
    view.flags.writeable = False
    return view


def write(name: str, value: Array, buffer: Array) -> None:
    """Copy a finite array into a buffer of its shape; called at every tick."""
    if np.shape(value) != buffer.shape:
        raise InputError(name, f"shape {np.shape(value)}", f"shape {buffer.shape}")
    if not math.isfinite(np.add.reduce(value, axis=None)):
        raise InputError(name, value, "finite numbers")
    buffer[...] = value
