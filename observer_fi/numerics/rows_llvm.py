"""What `rows.py` is to the compiler: a row is a register of LLVM, a number a double; most lowerings do both."""

import math
import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import lower_builtin, models, register_model

from observer_fi.numerics import rows

_EACH_BYTE = 8  # rows start where a double may stand
_DOUBLE = ir.DoubleType()


class RowType(types.Type):
    """A row of `count` doubles."""

    def __init__(self, count: int) -> None:
        self.count = count
        super().__init__(name=f"Row{count}")


class RowsType(types.Type):
    """An array of rows of `count` doubles, with `ndim` indices."""

    def __init__(self, ndim: int, count: int) -> None:
        self.ndim, self.count = ndim, count
        super().__init__(name=f"Rows{ndim}x{count}")


def _register(kind: Any) -> Any:
    """The LLVM type of a row or a number."""
    return ir.VectorType(_DOUBLE, kind.count) if isinstance(kind, RowType | RowsType) else _DOUBLE


@register_model(RowType)
class _RowModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _register(kind))


@register_model(RowsType)
class _RowsModel(models.StructModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        members = [("data", types.CPointer(types.float64)), ("shape", types.UniTuple(types.intp, kind.ndim))]
        super().__init__(manager, kind, members)


# --- types ---


def _typed(result: Callable[[Any], Any]) -> type[AbstractTemplate]:
    """Typing of a function whose result, from the types of its arguments, is None where they do not fit."""

    class Template(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            kind = result(args)
            return None if kind is None else signature(kind, *args)

    return Template


def _is_place(args: Any) -> bool:
    return isinstance(args[0], types.Array) and args[0].layout == "C" and isinstance(args[1], types.Integer)


def _row_type(wide: Any) -> Any:
    return RowType(max(len(wide), 1))  # a row of nothing is never used, but it has a type


def _side_type(args: Any) -> Any:
    is_array = isinstance(args[0], types.Array) and args[0].layout == "C"
    return RowsType(args[0].ndim - 1, len(args[1])) if is_array else None


def _arithmetic(args: Any) -> Any:
    """A row from rows and doubles; None without a row, which is the compiler's own business."""
    found = {kind for kind in args if isinstance(kind, RowType)}
    fits = len(found) == 1 and all(isinstance(kind, RowType) or kind == types.float64 for kind in args)
    return found.pop() if fits else None


def _either(args: Any) -> Any:
    """A row where one of them is, else a double."""
    return next((kind for kind in args if isinstance(kind, RowType)), types.float64)


class _Either(AbstractTemplate):
    """Typing of a function of numbers or rows."""

    def generic(self, args: Any, kws: Any) -> Any:
        return signature(
            _either(args), *(kind if isinstance(kind, RowType) else types.float64 for kind in args)
        )


class _AnyOf(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        return signature(types.boolean, args[0] if isinstance(args[0], RowType) else types.float64)


def _indices(index: Any) -> int:
    return len(index) if isinstance(index, types.BaseTuple) else 1


def _got(args: Any) -> Any:
    """A row, or the rows behind the first index."""
    if not isinstance(args[0], RowsType):
        return None
    left = args[0].ndim - _indices(args[1])
    return RowsType(left, args[0].count) if left else RowType(args[0].count)


infer_global(rows.load)(_typed(lambda args: _row_type(args[2]) if _is_place(args) else None))
infer_global(rows.dot)(_typed(lambda args: types.float64))
infer_global(rows.zeros)(_typed(lambda args: _row_type(args[0])))
infer_global(rows.side_by_side)(_typed(_side_type))
infer_global(rows.any_of)(_AnyOf)
infer_global(rows.any_of_rare)(_AnyOf)
for _function in (
    rows.where_above,
    rows.maximum,
    rows.copysign,
    rows.zeros_like,
    rows.exp,
    rows.log,
    rows.sqrt,
    rows.tanh,
    rows.sin,
    rows.cos,
    rows.floor,
):
    infer_global(_function)(_Either)
_ARITHMETIC = {
    operator.add: "fadd", operator.sub: "fsub", operator.mul: "fmul", operator.truediv: "fdiv",
    operator.iadd: "fadd", operator.isub: "fsub", operator.imul: "fmul",
}  # fmt: skip
for _operator in (*_ARITHMETIC, operator.neg, operator.pow, abs):
    infer_global(_operator)(_typed(_arithmetic))
infer_global(operator.getitem)(_typed(_got))
infer_global(operator.setitem)(_typed(lambda args: types.none if isinstance(args[0], RowsType) else None))


# --- memory ---


def _pointer(context: Any, builder: Any, sig: Any, args: Any, kind: Any) -> Any:
    data = context.make_array(sig.args[0])(context, builder, args[0]).data
    at = context.cast(builder, args[1], sig.args[1], types.intp)
    return builder.bitcast(builder.gep(data, [at]), kind.as_pointer())


@lower_builtin(rows.load, types.Array, types.Integer, types.BaseTuple)
def _load(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return builder.load(_pointer(context, builder, sig, args, _register(sig.return_type)), align=_EACH_BYTE)


@lower_builtin(rows.side_by_side, types.Array, types.BaseTuple)
def _side_by_side(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    array = context.make_array(sig.args[0])(context, builder, args[0])
    made = cgutils.create_struct_proxy(sig.return_type)(context, builder)
    made.data = array.data
    shape = cgutils.unpack_tuple(builder, array.shape)[: sig.return_type.ndim]
    made.shape = cgutils.pack_array(builder, shape)
    return made._getvalue()


def _place(context: Any, builder: Any, sig: Any, args: Any) -> tuple[Any, list[Any]]:
    """Pointer to the first number behind some indices, and the sides that are left."""
    kind, index_kind = sig.args[:2]
    made = cgutils.create_struct_proxy(kind)(context, builder, args[0])
    shape = cgutils.unpack_tuple(builder, made.shape)
    given: list[Any] = [(args[1], index_kind)]
    if isinstance(index_kind, types.BaseTuple):
        given = list(zip(cgutils.unpack_tuple(builder, args[1]), iter(index_kind), strict=True))  # type: ignore[call-overload]
    at = ir.Constant(ir.IntType(64), 0)
    for k, side in enumerate(shape):
        at = builder.mul(at, side) if k else at
        if k < len(given):
            at = builder.add(at, context.cast(builder, *given[k], types.intp))
    at = builder.mul(at, ir.Constant(ir.IntType(64), kind.count))
    return builder.gep(made.data, [at]), shape[len(given) :]


@lower_builtin(operator.getitem, RowsType, types.Integer)
@lower_builtin(operator.getitem, RowsType, types.BaseTuple)
def _getitem(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    pointer, left = _place(context, builder, sig, args)
    if isinstance(sig.return_type, RowType):
        return builder.load(
            builder.bitcast(pointer, _register(sig.return_type).as_pointer()), align=_EACH_BYTE
        )
    made = cgutils.create_struct_proxy(sig.return_type)(context, builder)
    made.data, made.shape = pointer, cgutils.pack_array(builder, left)
    return made._getvalue()


@lower_builtin(operator.setitem, RowsType, types.Integer, RowType)
@lower_builtin(operator.setitem, RowsType, types.BaseTuple, RowType)
def _setitem(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    pointer, _ = _place(context, builder, sig, args)
    builder.store(args[2], builder.bitcast(pointer, _register(sig.args[2]).as_pointer()), align=_EACH_BYTE)
    return context.get_dummy_value()


# --- arithmetic ---


def _spread(builder: Any, number: Any, vector: Any) -> Any:
    """A number in every place of a row; rows, and numbers among numbers, as they are."""
    if number.type == vector:
        return number
    empty = ir.Constant(vector, ir.Undefined)
    first = builder.insert_element(empty, number, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(
        first, empty, ir.Constant(ir.VectorType(ir.IntType(32), vector.count), None)
    )


def _constant(vector: Any, number: float) -> Any:
    return ir.Constant(vector, [number] * vector.count if isinstance(vector, ir.VectorType) else number)


def _alike(lower: Callable[..., Any]) -> Any:
    """A lowering from its arguments in the form of the result: lower(context, builder, form, *values)."""

    def lowered(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        form = _register(sig.return_type)
        return lower(context, builder, form, *(_spread(builder, a, form) for a in args))

    return lowered


def _instruction(name: str) -> Any:
    return _alike(lambda context, builder, form, *values: getattr(builder, name)(*values))


def _intrinsic(name: str) -> Any:
    def lower(context: Any, builder: Any, form: Any, *values: Any) -> Any:
        full = f"llvm.{name}.{'f64' if form == _DOUBLE else f'v{form.count}f64'}"
        kind = ir.FunctionType(form, [form] * len(values))
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, full), values)

    return _alike(lower)


def _each(function: Any) -> Any:
    """The compiler's own function of doubles, number after number."""

    def lower(context: Any, builder: Any, form: Any, *values: Any) -> Any:
        call = context.get_function(function, signature(types.float64, *[types.float64] * len(values)))
        if form == _DOUBLE:
            return call(builder, values)
        out = ir.Constant(form, ir.Undefined)
        for k in range(form.count):
            at = ir.Constant(ir.IntType(32), k)
            out = builder.insert_element(
                out, call(builder, [builder.extract_element(v, at) for v in values]), at
            )
        return out

    return _alike(lower)


_NUMBER = types.Number
for _operator, _name in _ARITHMETIC.items():
    for _kinds in ((RowType, RowType), (RowType, types.Float), (types.Float, RowType)):
        lower_builtin(_operator, *_kinds)(_instruction(_name))
for _kinds in ((RowType, RowType), (RowType, types.Float), (types.Float, RowType)):
    lower_builtin(operator.pow, *_kinds)(_each(operator.pow))
lower_builtin(operator.neg, RowType)(_instruction("fneg"))
lower_builtin(abs, RowType)(_intrinsic("fabs"))
lower_builtin(rows.copysign, types.Any, types.Any)(_intrinsic("copysign"))
for _function, _scalar in ((rows.tanh, math.tanh), (rows.sin, math.sin), (rows.cos, math.cos)):
    lower_builtin(_function, types.Any)(_each(_scalar))
lower_builtin(rows.floor, types.Any)(_intrinsic("floor"))
lower_builtin(rows.sqrt, types.Any)(_intrinsic("sqrt"))
lower_builtin(rows.exp, types.Float)(_each(math.exp))
lower_builtin(rows.log, types.Float)(_each(math.log))


@lower_builtin(rows.where_above, types.Any, types.Any, types.Any, types.Any)
@_alike
def _where_above(context: Any, builder: Any, form: Any, u: Any, v: Any, yes: Any, no: Any) -> Any:
    return builder.select(builder.fcmp_ordered(">", u, v), yes, no)


@lower_builtin(rows.maximum, types.Any, types.Any)
@_alike
def _maximum(context: Any, builder: Any, form: Any, u: Any, v: Any) -> Any:
    return builder.select(builder.fcmp_ordered(">", u, v), u, v)


@lower_builtin(rows.zeros_like, types.Any)
@lower_builtin(rows.zeros, types.BaseTuple)
def _zeros(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return _constant(_register(sig.return_type), 0.0)


@lower_builtin(rows.any_of_rare, types.Any)
def _any_of_rare(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    found = _any_of(context, builder, sig, args)
    bit = ir.IntType(1)
    expect = cgutils.get_or_insert_function(
        builder.module, ir.FunctionType(bit, [bit, bit]), "llvm.expect.i1"
    )
    return builder.call(expect, [found, ir.Constant(bit, 0)])


@lower_builtin(rows.any_of, types.Any)
def _any_of(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    form = args[0].type
    found = builder.fcmp_unordered("!=", args[0], _constant(form, 0.0))
    if form == _DOUBLE:
        return found
    bits = ir.IntType(form.count)
    return builder.icmp_unsigned("!=", builder.bitcast(found, bits), ir.Constant(bits, 0))


@lower_builtin(rows.dot, RowType, RowType)
def _dot(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    vector = args[0].type
    name = f"llvm.vector.reduce.fadd.v{vector.count}f64"
    total = cgutils.get_or_insert_function(builder.module, ir.FunctionType(_DOUBLE, [_DOUBLE, vector]), name)
    return builder.call(total, [_constant(_DOUBLE, -0.0), builder.fmul(*args)], fastmath=("reassoc",))


# --- exp and log of rows ---

_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
_TAYLOR = tuple(1.0 / math.factorial(k) for k in range(13, -1, -1))  # within 2e-17 on +-ln 2 / 2
# fdlibm's e_log.c: log((1 + s) / (1 - s)) = 2 s + s R(s^2)
_LOG_ODD = (
    1.479819860511658591e-01, 1.531383769920937332e-01, 1.818357216161805012e-01, 2.222219843214978396e-01,
    2.857142874366239149e-01, 3.999999999940941908e-01, 6.666666666666735130e-01, 0.0,
)  # fmt: skip


def _polynomial(builder: Any, x: Any, coefficients: tuple[float, ...]) -> Any:
    """Horner's scheme, the highest power first."""
    total = _constant(x.type, coefficients[0])
    for c in coefficients[1:]:
        total = builder.fadd(
            builder.fmul(total, x, flags=("contract",)), _constant(x.type, c), flags=("contract",)
        )
    return total


@lower_builtin(rows.exp, RowType)
def _exp(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    """2^n exp(r) with |r| at most ln 2 / 2."""
    vector = _register(sig.return_type)
    whole = ir.VectorType(ir.IntType(64), vector.count)
    least = _constant(vector, rows.LEAST_EXPONENT)
    x = builder.select(builder.fcmp_ordered(">", args[0], least), args[0], least)
    magic = _constant(vector, 6755399441055744.0)  # adding it rounds, and leaves the integer in the last bits
    shifted = builder.fadd(builder.fmul(x, _constant(vector, 1.0 / math.log(2.0))), magic)
    n = builder.fsub(shifted, magic)
    r = builder.fsub(x, builder.fmul(n, _constant(vector, _LN2_HIGH)))
    r = builder.fsub(r, builder.fmul(n, _constant(vector, _LN2_LOW)))
    bits = builder.shl(builder.bitcast(shifted, whole), ir.Constant(whole, [52] * vector.count))
    power = builder.add(bits, builder.bitcast(_constant(vector, 1.0), whole))
    return builder.fmul(_polynomial(builder, r, _TAYLOR), builder.bitcast(power, vector))


@lower_builtin(rows.log, RowType)
def _log(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    """e ln 2 + log(1 + f) with 1 + f between sqrt(1/2) and sqrt(2)."""
    vector, x = _register(sig.return_type), args[0]
    whole = ir.VectorType(ir.IntType(64), vector.count)

    def number(value: int) -> Any:
        return ir.Constant(whole, [value] * vector.count)

    bits = builder.sub(builder.bitcast(x, whole), number(0x3FE6A09E667F3BCD))  # of sqrt(1/2)
    e = builder.sitofp(builder.ashr(bits, number(52)), vector)
    mantissa = builder.add(builder.and_(bits, number((1 << 52) - 1)), number(0x3FE6A09E667F3BCD))
    f = builder.fsub(builder.bitcast(mantissa, vector), _constant(vector, 1.0))
    s = builder.fdiv(f, builder.fadd(f, _constant(vector, 2.0)))
    half = builder.fmul(builder.fmul(f, f), _constant(vector, 0.5))
    R = builder.fadd(half, _polynomial(builder, builder.fmul(s, s), _LOG_ODD))
    low = builder.fadd(builder.fmul(s, R), builder.fmul(e, _constant(vector, _LN2_LOW)))
    total = builder.fsub(
        builder.fmul(e, _constant(vector, _LN2_HIGH)), builder.fsub(builder.fsub(half, low), f)
    )
    is_number = builder.and_(
        builder.fcmp_ordered(">", x, _constant(vector, 0.0)),
        builder.fcmp_ordered("<", x, _constant(vector, math.inf)),
    )
    return builder.select(is_number, total, _constant(vector, math.nan))
