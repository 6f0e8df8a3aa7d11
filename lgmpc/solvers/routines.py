"""Addresses of SciPy's BLAS and LAPACK routines, for lgmpc's C code."""

from __future__ import annotations

import ctypes

from scipy.linalg import cython_blas, cython_lapack

__all__ = ["routine_addresses"]


def routine_addresses(*names: str) -> list[int]:
    """Return the addresses of routines (``dgemm``, ``dpotrf``, ...), in order; arguments are pointers, as in Fortran.

    Args:
        names: in lower case, with the letter of the precision.
    """
    name_of, pointer_of = ctypes.pythonapi.PyCapsule_GetName, ctypes.pythonapi.PyCapsule_GetPointer
    name_of.restype, name_of.argtypes = ctypes.c_char_p, [ctypes.py_object]
    pointer_of.restype, pointer_of.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    found = []
    for name in names:
        module = cython_blas if name in cython_blas.__pyx_capi__ else cython_lapack
        capsule = module.__pyx_capi__[name]
        found.append(int(pointer_of(capsule, name_of(capsule))))
    return found
