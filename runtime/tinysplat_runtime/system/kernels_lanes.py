"""Eight float32 at once as numbers of compiled code: what a loop over eight pixels would need luck to become.

    x = load(plane, at)
    store(plane, at, where(x > low, x * x, low))

One operand of `+ - * /`, of a comparison and of the functions here may be a single float32. LLVM splits lanes where a
processor's vectors are shorter.
"""

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import extending, types
from numba.core.typing.templates import ConcreteTemplate, infer_global

LANES = 8
"""The floats of a 32-byte vector."""


class _Lanes(types.Type):
    """Eight of a kind."""


_floats, _truths = _Lanes("float32 × 8"), _Lanes("bool × 8")
_FLOATS, _BITS, _TRUTHS = (ir.VectorType(kind, LANES) for kind in (ir.FloatType(), ir.IntType(32), ir.IntType(1)))
_UNDEFINED, _FIRST = ir.Constant(_FLOATS, ir.Undefined), ir.Constant(ir.IntType(32), 0)
_FLAGS = ("contract",)  # as `kernels_compile.OPTIONS`


@extending.register_model(_Lanes)
class _Model(extending.models.PrimitiveModel):
    def __init__(self, manager: Any, kind: types.Type) -> None:
        super().__init__(manager, kind, _FLOATS if kind == _floats else _TRUTHS)  # type: ignore[no-untyped-call]


def _intrinsic(typed: Callable[..., Any]) -> Any:
    return extending.intrinsic(typed)


def _every(builder: Any, value: Any) -> Any:
    """A vector; of a single number, with that in every lane."""
    if isinstance(value.type, ir.VectorType):
        return value
    one = builder.insert_element(_UNDEFINED, value, _FIRST)
    return builder.shuffle_vector(one, _UNDEFINED, ir.Constant(_BITS, None))


def _made(build: Callable[..., Any], *arguments: types.Type, result: types.Type = _floats) -> Any:
    """What numba asks of an intrinsic: its signature, and what builds its instructions from vectors."""

    def code(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        return build(builder, *(_every(builder, value) for value in given))

    return result(*arguments), code


def _operate(operation: Callable[..., Any], build: Callable[..., Any], of: types.Type, result: types.Type) -> None:
    """Make an operator of Python's work on lanes: no function, which would be compiled for every pair of types."""
    pairs = [(of, of), *([(of, types.float32), (types.float32, of)] if of == _floats else [])]

    def code(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        return build(builder, *(_every(builder, value) for value in given))

    class Cases(ConcreteTemplate):
        cases = [result(*pair) for pair in pairs]  # noqa: RUF012  # as numba's own

    infer: Any = infer_global
    infer(operation)(Cases)
    lower: Any = extending.lower_builtin
    for pair in pairs:
        lower(operation, *pair)(code)


for _operator, _name in (
    (operator.add, "fadd"),
    (operator.iadd, "fadd"),
    (operator.sub, "fsub"),
    (operator.mul, "fmul"),
    (operator.truediv, "fdiv"),
):
    _operate(_operator, lambda builder, a, b, name=_name: getattr(builder, name)(a, b, flags=_FLAGS), _floats, _floats)
for _operator, _name in ((operator.lt, "<"), (operator.gt, ">"), (operator.ge, ">="), (operator.le, "<=")):
    _operate(_operator, lambda builder, a, b, name=_name: builder.fcmp_ordered(name, a, b), _floats, _truths)
_operate(operator.and_, lambda builder, a, b: builder.and_(a, b), _truths, _truths)


@_intrinsic
def lanes(typing: Any, value: Any) -> Any:
    """A float32 in every lane."""
    return _made(lambda builder, a: a, types.float32)


@_intrinsic
def ramp(typing: Any) -> Any:
    """0, 1, … 7."""
    return _made(lambda builder: ir.Constant(_FLOATS, [*map(float, range(LANES))]))


@_intrinsic
def least(typing: Any, a: Any, b: Any) -> Any:
    """The lesser of each."""
    return _made(lambda builder, a, b: builder.select(builder.fcmp_ordered("<", a, b), a, b), a, b)


@_intrinsic
def most(typing: Any, a: Any, b: Any) -> Any:
    """The greater of each."""
    return _made(lambda builder, a, b: builder.select(builder.fcmp_ordered(">", a, b), a, b), a, b)


@_intrinsic
def where(typing: Any, condition: Any, yes: Any, no: Any) -> Any:
    """Lane by lane, one or the other."""
    return _made(lambda builder, condition, yes, no: builder.select(condition, yes, no), condition, yes, no)


@_intrinsic
def total(typing: Any, value: Any) -> Any:
    """The sum of all lanes, a float32."""

    def build(builder: Any, found: Any) -> Any:
        for apart in (4, 2, 1):
            other = ir.Constant(_BITS, [(lane + apart) % LANES for lane in range(LANES)])
            found = builder.fadd(found, builder.shuffle_vector(found, found, other))
        return builder.extract_element(found, _FIRST)

    return _made(build, value, result=types.float32)


@_intrinsic
def halves(typing: Any, value: Any) -> Any:
    """Of positive numbers, what they are without their fraction, and 2^(that − 127)."""

    def code(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        whole = builder.fptosi(given[0], _BITS)
        power = builder.bitcast(builder.shl(whole, ir.Constant(_BITS, [23] * LANES)), _FLOATS)
        return context.make_tuple(builder, signature.return_type, [builder.sitofp(whole, _FLOATS), power])

    pair: Any = types.UniTuple
    return pair(_floats, 2)(value), code


@_intrinsic
def load(typing: Any, array: Any, at: Any) -> Any:
    """Eight of a contiguous (n,) float32 array from an index of 64 bits on, which is not checked."""

    def code(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        return builder.load(_place(context, builder, array, *given), align=4)

    return _floats(array, at), code


@_intrinsic
def store(typing: Any, array: Any, at: Any, value: Any) -> Any:
    """Write where `load` reads."""

    def code(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        builder.store(given[2], _place(context, builder, array, *given[:2]), align=4)
        return context.get_dummy_value()

    return types.void(array, at, value), code


def _place(context: Any, builder: Any, kind: Any, array: Any, at: Any) -> Any:
    first = context.make_array(kind)(context, builder, value=array).data
    return builder.bitcast(builder.gep(first, [at]), _FLOATS.as_pointer())
