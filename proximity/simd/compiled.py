"""The functions on vectors as compiled code: each a few LLVM instructions, put into the caller.

A function that takes plain floats as well lets one formula serve eight triangles or one.
"""

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from proximity.simd.vectors import LANES, LLVM, Vector, f32x8, f64x8, mask8, suffix


def _splat(builder, value, vector_type):
    """All lanes of an LLVM vector equal to *value*."""
    undefined = ir.Constant(vector_type, ir.Undefined)
    first = builder.insert_element(undefined, value, ir.Constant(ir.IntType(32), 0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    return builder.shuffle_vector(first, undefined, zeros)


def _element_pointer(context, builder, array_type, array, offset, target):
    """Address of ``array[offset]``, as a pointer to the LLVM type *target*."""
    data = context.make_array(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [offset]), target.as_pointer())


@intrinsic
def load(typingctx, array, offset):
    vector = {types.float32: f32x8, types.float64: f64x8}[array.dtype]

    def codegen(context, builder, sig, args):
        pointer = _element_pointer(context, builder, sig.args[0], args[0], args[1], LLVM[vector])
        return builder.load(pointer, align=vector.element.bitwidth // 8)

    return vector(array, types.intp), codegen


@intrinsic
def prefetch(typingctx, array, offset):
    def codegen(context, builder, sig, args):
        pointer = _element_pointer(context, builder, sig.args[0], args[0], args[1], ir.IntType(8))
        number = ir.IntType(32)
        fnty = ir.FunctionType(ir.VoidType(), [pointer.type, number, number, number])
        fn = cgutils.get_or_insert_function(builder.module, fnty, "llvm.prefetch.p0i8")
        read, everywhere, data = (ir.Constant(number, value) for value in (0, 3, 1))
        builder.call(fn, [pointer, read, everywhere, data])
        return context.get_dummy_value()

    return types.void(array, types.intp), codegen


@intrinsic
def load_int(typingctx, array, offset):
    def codegen(context, builder, sig, args):
        pointer = _element_pointer(context, builder, sig.args[0], args[0], args[1], ir.IntType(32))
        return builder.sext(builder.load(pointer, align=4), ir.IntType(64))

    return types.int64(array, types.intp), codegen


@intrinsic
def store(typingctx, array, offset, vector):
    def codegen(context, builder, sig, args):
        pointer = _element_pointer(context, builder, sig.args[0], args[0], args[1], LLVM[vector])
        builder.store(args[2], pointer, align=vector.element.bitwidth // 8)
        return context.get_dummy_value()

    return types.void(array, types.intp, vector), codegen


@intrinsic
def compress(typingctx, vector, mask):
    def codegen(context, builder, sig, args):
        llvm = LLVM[vector]
        fnty = ir.FunctionType(llvm, [llvm, LLVM[mask8], llvm])
        name = f"llvm.experimental.vector.compress.{suffix(vector)}"
        fn = cgutils.get_or_insert_function(builder.module, fnty, name)
        return builder.call(fn, [*args, ir.Constant(llvm, ir.Undefined)])

    return vector(vector, mask8), codegen


@intrinsic
def splat(typingctx, value):
    def codegen(context, builder, sig, args):
        return _splat(builder, args[0], LLVM[f64x8])

    return f64x8(types.float64), codegen


@intrinsic
def splat32(typingctx, value):
    def codegen(context, builder, sig, args):
        return _splat(builder, args[0], LLVM[f32x8])

    return f32x8(types.float32), codegen


@intrinsic
def lane_numbers(typingctx):
    def codegen(context, builder, sig, args):
        return ir.Constant(LLVM[f32x8], [float(i) for i in range(LANES)])

    return f32x8(), codegen


@intrinsic
def widen(typingctx, vector):
    def codegen(context, builder, sig, args):
        return builder.fpext(args[0], LLVM[f64x8])

    return f64x8(f32x8), codegen


@intrinsic
def narrow(typingctx, vector):
    def codegen(context, builder, sig, args):
        return builder.fptrunc(args[0], LLVM[f32x8])

    return f32x8(f64x8), codegen


@intrinsic
def fma(typingctx, a, b, c):
    ty = _common_type(a, b, c)

    def codegen(context, builder, sig, args):
        llvm = context.get_value_type(ty)
        fnty = ir.FunctionType(llvm, [llvm] * 3)
        fn = cgutils.get_or_insert_function(builder.module, fnty, f"llvm.fma.{suffix(ty)}")
        return builder.call(fn, args)

    return ty(ty, ty, ty), codegen


def _common_type(*arguments):
    """The one float type of an operation; integers and literals count as float64."""
    vectors = {ty for ty in arguments if isinstance(ty, Vector)}
    if vectors:
        (ty,) = vectors
        return ty
    return types.float32 if all(ty == types.float32 for ty in arguments) else types.float64


@intrinsic
def minimum(typingctx, a, b):
    ty = _common_type(a, b)

    def codegen(context, builder, sig, args):
        return builder.select(builder.fcmp_ordered("<", *args), *args)

    return ty(ty, ty), codegen


@intrinsic
def maximum(typingctx, a, b):
    ty = _common_type(a, b)

    def codegen(context, builder, sig, args):
        return builder.select(builder.fcmp_ordered(">", *args), *args)

    return ty(ty, ty), codegen


@intrinsic
def select(typingctx, mask, a, b):
    ty = a if a == mask8 else _common_type(a, b)
    condition = mask8 if isinstance(ty, Vector) else types.boolean

    def codegen(context, builder, sig, args):
        return builder.select(*args)

    return ty(condition, ty, ty), codegen


def _unary(name):
    @intrinsic
    def function(typingctx, a):
        ty = _common_type(a)

        def codegen(context, builder, sig, args):
            llvm = context.get_value_type(ty)
            fnty = ir.FunctionType(llvm, [llvm])
            fn = cgutils.get_or_insert_function(builder.module, fnty, f"llvm.{name}.{suffix(ty)}")
            return builder.call(fn, args)

        return ty(ty), codegen

    return function


@intrinsic
def bits(typingctx, mask):
    def codegen(context, builder, sig, args):
        return builder.zext(builder.bitcast(args[0], ir.IntType(LANES)), ir.IntType(64))

    return types.int64(mask8), codegen


@intrinsic
def lane(typingctx, vector, index):
    def codegen(context, builder, sig, args):
        return builder.extract_element(args[0], builder.trunc(args[1], ir.IntType(32)))

    return vector.element(vector, types.int64), codegen


@intrinsic
def horizontal_min(typingctx, vector):
    def codegen(context, builder, sig, args):
        # Three halvings; llvm.vector.reduce.fmin would add instructions for NaN.
        llvm = LLVM[vector]
        value = args[0]
        for step in (4, 2, 1):
            order = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [i ^ step for i in range(LANES)])
            other = builder.shuffle_vector(value, ir.Constant(llvm, ir.Undefined), order)
            value = builder.select(builder.fcmp_ordered("<", value, other), value, other)
        return builder.extract_element(value, ir.Constant(ir.IntType(32), 0))

    return vector.element(vector), codegen


@intrinsic
def lowest_lane(typingctx, bounds):
    def codegen(context, builder, sig, args):
        # Numbers that are not negative order like their bits; the three lowest make room for the lane.
        i32 = ir.IntType(32)
        vector = ir.VectorType(i32, LANES)
        keys = builder.and_(builder.bitcast(args[0], vector), ir.Constant(vector, [~7] * LANES))
        keys = builder.or_(keys, ir.Constant(vector, list(range(LANES))))
        for step in (4, 2, 1):
            order = ir.Constant(vector, [i ^ step for i in range(LANES)])
            other = builder.shuffle_vector(keys, ir.Constant(vector, ir.Undefined), order)
            keys = builder.select(builder.icmp_unsigned("<", keys, other), keys, other)
        first = builder.extract_element(keys, ir.Constant(i32, 0))
        return builder.zext(builder.and_(first, ir.Constant(i32, 7)), ir.IntType(64))

    return types.int64(f32x8), codegen


@intrinsic
def nearest_lane(typingctx, bounds, mask):
    lowest = lowest_lane._defn(typingctx, bounds)[1]

    def codegen(context, builder, sig, args):
        infinite = ir.Constant(LLVM[f32x8], [float("inf")] * LANES)
        chosen = builder.select(args[1], args[0], infinite)
        return lowest(context, builder, types.int64(f32x8), [chosen])

    return types.int64(f32x8, mask8), codegen


@intrinsic
def trailing_zeros(typingctx, value):
    def codegen(context, builder, sig, args):
        return builder.cttz(args[0], ir.Constant(ir.IntType(1), 1))

    return types.int64(types.int64), codegen


@intrinsic
def count_bits(typingctx, value):
    def codegen(context, builder, sig, args):
        return builder.ctpop(args[0])

    return types.int64(types.int64), codegen


absolute = _unary("fabs")
square_root = _unary("sqrt")
