"""How kernels are compiled: one set of numba's options, kept on disk where there is a place that can be written to."""

import gc
from collections.abc import Callable
from typing import Any

from numba import njit
from numba.core import event
from numba.core.caching import FunctionCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler

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
    """Says of a step, while it compiles, that this is done once.

    Meanwhile nobody looks for garbage: numba makes objects by the million, and looking took a sixth of the time.
    """

    def __init__(self) -> None:
        self._depth, self._collects = 0, False

    def on_start(self, event: event.Event) -> None:
        compiling.begin()
        if not self._depth:
            self._collects = gc.isenabled()
            gc.disable()
        self._depth += 1

    def on_end(self, event: event.Event) -> None:
        compiling.end()
        self._depth -= 1
        if not self._depth and self._collects:
            gc.enable()


KEPT_IN = _kept_in()
compiling.is_kept = bool(KEPT_IN)
_register: Any = event.register
_register("numba:compile", _Aside())


# A product and a sum may become one instruction; nothing else of "fast math" is safe with infinities about.
OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": {"contract"}}


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


class _Part(JITCodeLibrary):
    """A function whose callers' compilation optimises it and makes machine code of it, once for all that they link."""

    class _Never:
        def set_env(self, name: str, environment: object) -> None:
            """Machine code would need it."""

    codegen = _Never()

    def _optimize_functions(self, module: Any) -> None:
        module.data_layout = self._codegen._data_layout

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()  # type: ignore[no-untyped-call]
        self._finalized = True


class _Parts(Compiler):
    def define_pipelines(self) -> Any:
        state = self.state
        codegen = state.targetctx.codegen()
        state.library = _Part(codegen, state.func_id.func_qualname)  # type: ignore[no-untyped-call]
        state.library.enable_object_caching()
        return super().define_pipelines()  # type: ignore[no-untyped-call]


compiled = _kept(**OPTIONS, cache=bool(KEPT_IN), no_cfunc_wrapper=True)
"""Of functions that Python calls."""

_WITHIN: dict[str, Any] = {"pipeline_class": _Parts, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
within: Any = njit(**OPTIONS, **_WITHIN)
"""Of functions that only other kernels call, in whose machine code theirs is: half as long to compile."""
