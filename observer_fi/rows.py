"""A few numbers side by side: one register where a kernel is compiled, a slice of an array where it is not.

LLVM finds no vectors in loops over so few numbers in arrays that might overlap; here they are said. In plain Python a row
is a numpy array, which has the same operators.
"""

import math
import operator
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import lower_builtin, models, register_model

MOST = 8
Wide = tuple[int, ...]  # as many zeros as a row has numbers: the compiler knows the length of a tuple


def wide_enough(n: int) -> Wide:
    """Rows for n numbers: none, one, or eight, so that few kernels are compiled."""
    if n > MOST:
        raise ValueError(f"a row holds at most {MOST} numbers, got {n}")
    return (0,) * (n if n < 2 else MOST)


def load(a: Any, at: int, wide: Wide) -> Any:
    """The numbers of an array from `at` on, counted through its rows."""
    return a.reshape(-1)[at : at + len(wide)].copy()


def store(a: Any, at: int, row: Any) -> None:
    """A row into an array from `at` on, counted through its rows."""
    a.reshape(-1)[at : at + row.size] = row


def get(a: Any, at: int) -> float:
    """The number of an array at `at`, counted through its rows."""
    return float(a.reshape(-1)[at])


def put(a: Any, at: int, number: float) -> None:
    """A number into an array at `at`, counted through its rows."""
    a.reshape(-1)[at] = number


def dot(u: Any, v: Any) -> float:
    """Sum of the products."""
    return float(np.dot(u, v))


def zeros(wide: Wide) -> Any:
    """A row of zeros."""
    return np.zeros(len(wide))


def exp(row: Any) -> Any:
    """exp of each number of at most 0, to 2e-16; what is below -708 counts as -708."""
    return np.exp(np.maximum(row, LEAST_EXPONENT))


def log(row: Any) -> Any:
    """Natural logarithm of each number, to 2e-16; NaN where there is none. Numbers below 2.3e-308 are not for it."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where((row > 0.0) & (row < math.inf), np.log(row), math.nan)


def above(u: Any, v: Any, yes: Any, no: Any) -> Any:
    """yes where u is above v, else no (also where one of the two is no number)."""
    return np.where(u > v, yes, no)


LEAST_EXPONENT = -708.0


# --- what they are to the compiler ---


class RowType(types.Type):
    """A row of `count` doubles."""

    def __init__(self, count: int) -> None:
        self.count = count
        super().__init__(name=f"Row{count}")


_EACH_BYTE = 8  # rows start where a double may stand
_ARITHMETIC = {operator.add: "fadd", operator.sub: "fsub", operator.mul: "fmul", operator.truediv: "fdiv"}


@register_model(RowType)
class _Model(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _vector(kind))


def _vector(kind: Any) -> Any:
    return ir.VectorType(ir.DoubleType(), kind.count)


def _typed(result: Any) -> type[AbstractTemplate]:
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


def _arithmetic(args: Any) -> Any:
    rows = {kind for kind in args if isinstance(kind, RowType)}
    fits = len(rows) == 1 and all(isinstance(kind, RowType) or kind == types.float64 for kind in args)
    return rows.pop() if fits else None


infer_global(load)(_typed(lambda args: _row_type(args[2]) if _is_place(args) else None))
infer_global(store)(_typed(lambda args: types.none if _is_place(args) else None))
infer_global(get)(_typed(lambda args: types.float64 if _is_place(args) else None))
infer_global(put)(_typed(lambda args: types.none if _is_place(args) else None))
infer_global(dot)(_typed(lambda args: types.float64))
infer_global(above)(_typed(lambda args: next(a for a in args if isinstance(a, RowType))))
infer_global(exp)(_typed(lambda args: args[0]))
infer_global(log)(_typed(lambda args: args[0]))
infer_global(zeros)(_typed(lambda args: _row_type(args[0])))
for _operator in _ARITHMETIC:
    infer_global(_operator)(_typed(_arithmetic))


def _pointer(context: Any, builder: Any, sig: Any, args: Any, kind: Any) -> Any:
    data = context.make_array(sig.args[0])(context, builder, args[0]).data
    at = context.cast(builder, args[1], sig.args[1], types.intp)
    return builder.bitcast(builder.gep(data, [at]), kind.as_pointer())


@lower_builtin(load, types.Array, types.Integer, types.BaseTuple)
def _load(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return builder.load(_pointer(context, builder, sig, args, _vector(sig.return_type)), align=_EACH_BYTE)


@lower_builtin(store, types.Array, types.Integer, RowType)
def _store(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    builder.store(args[2], _pointer(context, builder, sig, args, _vector(sig.args[2])), align=_EACH_BYTE)
    return context.get_dummy_value()


@lower_builtin(get, types.Array, types.Integer)
def _get(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return builder.load(_pointer(context, builder, sig, args, ir.DoubleType()))


@lower_builtin(put, types.Array, types.Integer, types.Float)
def _put(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    builder.store(args[2], _pointer(context, builder, sig, args, ir.DoubleType()))
    return context.get_dummy_value()


@lower_builtin(dot, RowType, RowType)
def _dot(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    double, vector = ir.DoubleType(), _vector(sig.args[0])
    name = f"llvm.vector.reduce.fadd.v{vector.count}f64"
    total = cgutils.get_or_insert_function(builder.module, ir.FunctionType(double, [double, vector]), name)
    return builder.call(total, [ir.Constant(double, -0.0), builder.fmul(*args)], fastmath=("reassoc",))


@lower_builtin(zeros, types.BaseTuple)
def _zeros(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return ir.Constant(_vector(sig.return_type), None)


def _spread(builder: Any, number: Any, vector: Any) -> Any:
    nothing = ir.Constant(vector, ir.Undefined)
    first = builder.insert_element(nothing, number, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(
        first, nothing, ir.Constant(ir.VectorType(ir.IntType(32), vector.count), None)
    )


def _lowered(instruction: str) -> Any:
    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        vector = _vector(sig.return_type)
        pair = [
            a if isinstance(kind, RowType) else _spread(builder, a, vector)
            for a, kind in zip(args, sig.args, strict=True)
        ]
        return getattr(builder, instruction)(*pair)

    return lower


for _operator, _instruction in _ARITHMETIC.items():
    for _kinds in ((RowType, RowType), (RowType, types.Float), (types.Float, RowType)):
        lower_builtin(_operator, *_kinds)(_lowered(_instruction))


@lower_builtin(above, types.Any, types.Any, types.Any, types.Any)
def _above(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    vector = _vector(sig.return_type)
    u, v, yes, no = (
        a if isinstance(kind, RowType) else _spread(builder, a, vector)
        for a, kind in zip(args, sig.args, strict=True)
    )
    return builder.select(builder.fcmp_ordered(">", u, v), yes, no)


def _constant(vector: Any, number: float) -> Any:
    return ir.Constant(vector, [number] * vector.count)


def _polynomial(builder: Any, x: Any, coefficients: tuple[float, ...]) -> Any:
    """Horner's scheme, the highest power first."""
    total = _constant(x.type, coefficients[0])
    for c in coefficients[1:]:
        total = builder.fadd(
            builder.fmul(total, x, flags=("contract",)), _constant(x.type, c), flags=("contract",)
        )
    return total


_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
_TAYLOR = tuple(1.0 / math.factorial(k) for k in range(13, -1, -1))  # within 2e-17 on +-ln 2 / 2
# fdlibm's e_log.c: log((1 + s) / (1 - s)) = 2 s + s R(s^2)
_LOG_ODD = (
    1.479819860511658591e-01, 1.531383769920937332e-01, 1.818357216161805012e-01, 2.222219843214978396e-01,
    2.857142874366239149e-01, 3.999999999940941908e-01, 6.666666666666735130e-01, 0.0,
)  # fmt: skip


@lower_builtin(exp, RowType)
def _exp(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    """2^n exp(r) with |r| at most ln 2 / 2."""
    vector = _vector(sig.return_type)
    whole = ir.VectorType(ir.IntType(64), vector.count)
    least = _constant(vector, LEAST_EXPONENT)
    x = builder.select(builder.fcmp_ordered(">", args[0], least), args[0], least)
    magic = _constant(vector, 6755399441055744.0)  # adding it rounds, and leaves the integer in the last bits
    shifted = builder.fadd(builder.fmul(x, _constant(vector, 1.0 / math.log(2.0))), magic)
    n = builder.fsub(shifted, magic)
    r = builder.fsub(x, builder.fmul(n, _constant(vector, _LN2_HIGH)))
    r = builder.fsub(r, builder.fmul(n, _constant(vector, _LN2_LOW)))
    bits = builder.shl(builder.bitcast(shifted, whole), ir.Constant(whole, [52] * vector.count))
    power = builder.add(bits, builder.bitcast(_constant(vector, 1.0), whole))
    return builder.fmul(_polynomial(builder, r, _TAYLOR), builder.bitcast(power, vector))


@lower_builtin(log, RowType)
def _log(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    """e ln 2 + log(1 + f) with 1 + f between sqrt(1/2) and sqrt(2)."""
    vector, x = _vector(sig.return_type), args[0]
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
