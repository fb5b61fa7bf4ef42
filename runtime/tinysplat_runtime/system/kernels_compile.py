"""How kernels are compiled: one set of numba's options, kept on disk where there is a place that can be written to."""

from __future__ import annotations

from typing import Any

from numba import njit

Number = Any  # numba infers what kind when it compiles


def _is_kept() -> bool:
    """Whether compiled code can be stored; in containers neither this folder nor the user's cache may be writable."""

    def nothing() -> None:
        pass

    try:
        njit(cache=True)(nothing)
    except RuntimeError:
        return False
    return True


# A product and a sum may become one instruction; nothing else of "fast math" is safe with infinities about.
OPTIONS: dict[str, Any] = {"nogil": True, "cache": _is_kept(), "error_model": "numpy", "fastmath": {"contract"}}
compiled = njit(**OPTIONS)

# Sums over lanes may be vector sums, whose order the compiler fixes.
summing = njit(**{**OPTIONS, "fastmath": {"contract", "reassoc"}})
