"""The arithmetic of this process: what determines the last bits of its results.

Processors of one name may compute other bits, because environment variables such as
NPY_DISABLE_CPU_FEATURES, OPENBLAS_CORETYPE and GLIBC_TUNABLES choose other instructions.
"""

import ctypes
import hashlib
import math
import os
from functools import cache
from typing import Any

import numpy as np
from numpy.linalg import _umath_linalg

from omni_control.kinematics import Array

# Names under which OpenBLAS is built, each a prefix and a suffix of its functions
OPENBLAS_NAMES = (("", ""), ("", "64_"), ("scipy_", ""), ("scipy_", "64_"))
MATRIX_SIZES = (2, 3, 4, 5, 6, 8, 11, 16, 24, 33)


@cache
def describe_arithmetic() -> dict[str, str]:
    """Return the vector instructions and BLAS in use, flags of XLA, and a hash of sample results.

    Equal hashes do not prove that all results are equal. Different ones prove that some differ.
    """
    config: Any = np.show_config(mode="dicts")
    blas = config["Build Dependencies"]["blas"]
    simd = config.get("SIMD Extensions", {})
    return {
        "SIMD": " ".join([*simd.get("baseline", []), *simd.get("found", [])]),
        "BLAS": f"{blas['name']} {blas.get('version', '')} {_find_openblas_core()}".strip(),
        "XLA_FLAGS": os.environ.get("XLA_FLAGS", ""),
        "sample results": _hash_sample_results(),
    }


def _find_openblas_core() -> str:
    """Return the processor whose code numpy's OpenBLAS uses; empty for another library."""
    library = ctypes.CDLL(_umath_linalg.__file__)  # finds functions of the BLAS that it uses
    for prefix, suffix in OPENBLAS_NAMES:
        function = getattr(library, f"{prefix}openblas_get_corename{suffix}", None)
        if function is not None:
            function.restype = ctypes.c_char_p
            return str(function().decode())
    return ""


def _hash_sample_results() -> str:
    """Return a hash of results of elementary functions and small linear systems."""
    x = np.arange(1, 1025) / 128.0
    unit = x / 9.0
    results: list[Array] = [
        *(function(x) for function in (np.sin, np.cos, np.tan, np.exp, np.log, np.tanh, np.arctan)),
        *(function(unit) for function in (np.arcsin, np.arccos, np.expm1, np.log1p)),
        *(function(x, unit) for function in (np.arctan2, np.hypot, np.power)),
        # MuJoCo uses the C library, as the module math does.
        *(np.array([*map(f, x)]) for f in (math.sin, math.cos, math.exp, math.atan, math.sqrt)),
    ]
    for n in MATRIX_SIZES:
        matrix = np.sin(np.arange(float(n * n))).reshape(n, n) + n * np.eye(n)
        vector = 1.0 / np.arange(1.0, n + 1.0)
        symmetric = matrix @ matrix.T
        results += [
            symmetric,
            matrix @ vector,
            np.asarray(vector @ vector),
            np.einsum("ij,kj->ik", matrix, matrix),
            np.linalg.solve(matrix, vector),
            np.linalg.cholesky(symmetric),
        ]
    data = b"".join(result.tobytes() for result in results)
    return hashlib.sha256(data).hexdigest()[:12]
