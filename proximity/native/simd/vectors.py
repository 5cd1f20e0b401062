"""Vector types of numba and their operators.

Their values are LLVM vectors in registers; arrays hold only scalars.
"""

import operator

from llvmlite import ir
from numba import types
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import lower_builtin, models, register_model

from proximity.native.signature import LANES


class Vector(types.Type):
    """Eight lanes of one scalar type, which is boolean for a mask."""

    def __init__(self, name, element):
        self.element = element
        super().__init__(name=name)


f32x8 = Vector("f32x8", types.float32)
f64x8 = Vector("f64x8", types.float64)
mask8 = Vector("mask8", types.boolean)

LLVM = {
    f32x8: ir.VectorType(ir.FloatType(), LANES),
    f64x8: ir.VectorType(ir.DoubleType(), LANES),
    mask8: ir.VectorType(ir.IntType(1), LANES),
}
_FLOATS = (f32x8, f64x8, types.float32, types.float64)


@register_model(Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, dmm, fe_type):
        super().__init__(dmm, fe_type, LLVM[fe_type])


def suffix(ty):
    """Return the name of a type as used in LLVM's intrinsics."""
    return {f32x8: "v8f32", f64x8: "v8f64", types.float32: "f32", types.float64: "f64"}[ty]


_ARITHMETIC = {operator.add: "fadd", operator.sub: "fsub", operator.mul: "fmul", operator.truediv: "fdiv"}
_COMPARISONS = {operator.lt: "<", operator.le: "<=", operator.gt: ">", operator.ge: ">=", operator.eq: "=="}
_LOGIC = {operator.and_: "and_", operator.or_: "or_", operator.xor: "xor"}


def _define_binary(op, argument, result, emit):
    @lower_builtin(op, argument, argument)
    def lower(context, builder, sig, args):
        return emit(builder, *args)


for _op, _name in _ARITHMETIC.items():
    for _ty in (f32x8, f64x8):
        _define_binary(_op, _ty, _ty, lambda b, x, y, name=_name: getattr(b, name)(x, y))

    @infer_global(_op)
    class _ArithmeticTyping(ConcreteTemplate):
        cases = [signature(ty, ty, ty) for ty in (f32x8, f64x8)]  # noqa: RUF012 — numba reads a class attribute


for _op, _name in _COMPARISONS.items():
    for _ty in (f32x8, f64x8):
        _define_binary(_op, _ty, mask8, lambda b, x, y, name=_name: b.fcmp_ordered(name, x, y))

    @infer_global(_op)
    class _ComparisonTyping(ConcreteTemplate):
        cases = [signature(mask8, ty, ty) for ty in (f32x8, f64x8)]  # noqa: RUF012


for _op, _name in _LOGIC.items():
    _define_binary(_op, mask8, mask8, lambda b, x, y, name=_name: getattr(b, name)(x, y))

    @infer_global(_op)
    class _LogicTyping(ConcreteTemplate):
        cases = [signature(mask8, mask8, mask8)]  # noqa: RUF012


@infer_global(operator.neg)
class _NegTyping(ConcreteTemplate):
    cases = [signature(ty, ty) for ty in (f32x8, f64x8)]  # noqa: RUF012


@infer_global(operator.invert)
class _InvertTyping(ConcreteTemplate):
    cases = [signature(mask8, mask8)]  # noqa: RUF012


@lower_builtin(operator.neg, f32x8)
@lower_builtin(operator.neg, f64x8)
def _lower_neg(context, builder, sig, args):
    return builder.fneg(args[0])


@lower_builtin(operator.invert, mask8)
def _lower_invert(context, builder, sig, args):
    return builder.not_(args[0])
