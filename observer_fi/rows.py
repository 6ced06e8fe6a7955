"""A few numbers side by side: one register where a kernel is compiled, a slice of an array where it is not.

LLVM finds no vectors in loops over so few numbers in arrays that might overlap; here they are said. In plain Python a row
is a numpy array, which has the same operators.
"""

import operator
from typing import Any

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
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


# --- what they are to the compiler ---


class RowType(types.Type):
    """A row of `count` doubles."""

    def __init__(self, count: int) -> None:
        self.count = count
        super().__init__(name=f"Row{count}")


_EACH_BYTE = 8  # rows start where a double may stand
_ARITHMETIC = {operator.add: "fadd", operator.sub: "fsub", operator.mul: "fmul"}


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
