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

# Functions that name the processor, in builds of OpenBLAS with different prefixes and suffixes
OPENBLAS_CORE_FUNCTIONS = (
    "openblas_get_corename",
    "openblas_get_corename64_",
    "scipy_openblas_get_corename",
    "scipy_openblas_get_corename64_",
)
MATRIX_SIZES = (2, 3, 4, 6, 8, 11, 16, 33)


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
    for name in OPENBLAS_CORE_FUNCTIONS:
        if hasattr(library, name):
            function = library[name]
            function.restype = ctypes.c_char_p
            return str(function().decode())
    return ""


def _hash_sample_results() -> str:
    """Return a hash of results of elementary functions and small linear systems."""
    x = np.arange(1, 1025) / 128.0
    functions = (np.sin, np.tan, np.exp, np.log, np.tanh, np.arctan, np.expm1)
    c_functions = (math.sin, math.exp, math.atan)  # of the C library, which MuJoCo uses, too
    results = [function(x) for function in functions]
    results += [np.array([function(value) for value in x]) for function in c_functions]
    results += [np.arctan2(x, 3.0), np.hypot(x, 3.0), np.power(x, 0.3)]
    for n in MATRIX_SIZES:
        matrix = np.sin(np.arange(float(n * n))).reshape(n, n) + n * np.eye(n)
        vector = 1.0 / np.arange(1.0, n + 1.0)
        results += [matrix @ matrix, matrix @ vector, np.linalg.solve(matrix, vector)]
    data = b"".join(result.tobytes() for result in results)
    return hashlib.sha256(data).hexdigest()[:12]
