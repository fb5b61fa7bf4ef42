"""How kernels are compiled: one set of numba's options, kept on disk where there is a place that can be written to."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import njit
from numba.core import event
from numba.core.caching import FunctionCache

from .progress import compiling

Number = Any  # numba infers what kind when it compiles


def _kept_in() -> str:
    """The folder beside which compiled code is stored, empty where there is none: in containers neither this one nor
    the user's cache may be writable, nor `NUMBA_CACHE_DIR` given.
    """

    def nothing() -> None:
        pass

    try:
        return str(njit(cache=True)(nothing).stats.cache_path)
    except RuntimeError:
        return ""


class _Aside(event.Listener):
    """Says of a step, while it compiles, that this is done once."""

    def on_start(self, event: event.Event) -> None:
        compiling.begin()

    def on_end(self, event: event.Event) -> None:
        compiling.end()


KEPT_IN = _kept_in()
_register: Any = event.register
_register("numba:compile", _Aside())


# A product and a sum may become one instruction; nothing else of "fast math" is safe with infinities about.
OPTIONS: dict[str, Any] = {"nogil": True, "cache": bool(KEPT_IN), "error_model": "numpy", "fastmath": {"contract"}}


class _Cache(FunctionCache):
    """Numba's, which before it looks at how old an index is fails on types that another version had elsewhere."""

    def load_overload(self, signature: object, target: object) -> Any:
        try:
            return super().load_overload(signature, target)  # type: ignore[no-untyped-call]
        except (AttributeError, ImportError):
            self.flush()  # type: ignore[no-untyped-call]
            return None


def _kept(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    def decorate(function: Callable[..., Any]) -> Any:
        dispatcher = njit(**options)(function)
        if KEPT_IN:
            dispatcher._cache = _Cache(function)  # type: ignore[no-untyped-call]
        return dispatcher

    return decorate


compiled = _kept(**OPTIONS)
