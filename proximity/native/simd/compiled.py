"""Vector functions as compiled code. Each is a few LLVM instructions that are inlined into the caller.

Functions that also take plain floats let one formula serve eight triangles or one.
"""

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from proximity.native.signature import LANES
from proximity.native.simd.vectors import LLVM, Vector, f32x8, f64x8, mask8, suffix


def _splat(builder, value, vector_type):
    """Broadcast *value* to all lanes of an LLVM vector."""
    undefined = ir.Constant(vector_type, ir.Undefined)
    first = builder.insert_element(undefined, value, ir.Constant(ir.IntType(32), 0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    return builder.shuffle_vector(first, undefined, zeros)


def _element_pointer(context, builder, array_type, array, offset, target):
    """Return the address of ``array[offset]``, as a pointer to the LLVM type *target*."""
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


_ROW = ir.VectorType(ir.DoubleType(), 4)


def _row_pointers(context, builder, array_types, arrays, at, shift):
    """Yield the addresses of eight rows of four float64.

    The rows start at eight consecutive offsets, from position *at* on, plus *shift*.
    """
    offsets = context.make_array(array_types[1])(context, builder, arrays[1]).data
    for i in range(LANES):
        offset = builder.load(builder.gep(offsets, [builder.add(at, ir.Constant(at.type, i))]))
        offset = builder.add(offset, shift)
        yield _element_pointer(context, builder, array_types[0], arrays[0], offset, _ROW)


def _order(*lanes):
    return ir.Constant(ir.VectorType(ir.IntType(32), len(lanes)), lanes)


@intrinsic
def load_each(typingctx, array, offsets, at, shift):
    def codegen(context, builder, sig, args):
        vector = ir.Constant(LLVM[f64x8], ir.Undefined)
        pointers = _row_pointers(context, builder, sig.args[:2], args[:2], args[2], args[3])
        for i, pointer in enumerate(pointers):
            value = builder.load(builder.bitcast(pointer, ir.DoubleType().as_pointer()))
            vector = builder.insert_element(vector, value, ir.Constant(ir.IntType(32), i))
        return vector

    return f64x8(array, offsets, types.intp, types.intp), codegen


@intrinsic
def load_rows(typingctx, array, offsets, at, shift):
    def codegen(context, builder, sig, args):
        rows = [
            builder.load(pointer, align=8)
            for pointer in _row_pointers(context, builder, sig.args[:2], args[:2], args[2], args[3])
        ]
        wide = [builder.shuffle_vector(rows[i], rows[i + 4], _order(*range(8))) for i in range(4)]
        # Columns x and z of rows 0 1, then of 2 3; likewise y and w; then join halves.
        evens, odds = _order(0, 8, 2, 10, 4, 12, 6, 14), _order(1, 9, 3, 11, 5, 13, 7, 15)
        xz, more_xz = (builder.shuffle_vector(wide[i], wide[i + 1], evens) for i in (0, 2))
        yw, more_yw = (builder.shuffle_vector(wide[i], wide[i + 1], odds) for i in (0, 2))
        first, second = _order(0, 1, 8, 9, 4, 5, 12, 13), _order(2, 3, 10, 11, 6, 7, 14, 15)
        columns = [
            builder.shuffle_vector(one, other, order)
            for order in (first, second)
            for one, other in ((xz, more_xz), (yw, more_yw))
        ]
        return context.make_tuple(builder, sig.return_type, columns)

    return types.UniTuple(f64x8, 4)(array, offsets, types.intp, types.intp), codegen


@intrinsic
def add_rows(typingctx, array, offsets, at, shift, x, y, z):
    def codegen(context, builder, sig, args):
        x, y, z = args[4:]
        none = ir.Constant(LLVM[f64x8], [0.0] * LANES)
        pointers = _row_pointers(context, builder, sig.args[:2], args[:2], args[2], args[3])
        for i, pointer in enumerate(pointers):
            xy = builder.shuffle_vector(x, y, _order(i, LANES + i))
            zw = builder.shuffle_vector(z, none, _order(i, LANES + i))
            row = builder.shuffle_vector(xy, zw, _order(0, 1, 2, 3))
            builder.store(builder.fadd(builder.load(pointer, align=8), row), pointer, align=8)
        return context.get_dummy_value()

    return types.void(array, offsets, types.intp, types.intp, f64x8, f64x8, f64x8), codegen


@intrinsic
def prefetch(typingctx, array, offset):
    def codegen(context, builder, sig, args):
        pointer = _element_pointer(context, builder, sig.args[0], args[0], args[1], ir.IntType(8))
        i32 = ir.IntType(32)
        fnty = ir.FunctionType(ir.VoidType(), [pointer.type, i32, i32, i32])
        fn = cgutils.get_or_insert_function(builder.module, fnty, "llvm.prefetch.p0")
        # Arguments: read, nearest cache, data.
        builder.call(fn, [pointer, i32(0), i32(3), i32(1)])
        return context.get_dummy_value()

    return types.void(array, types.intp), codegen


def _constant(builder, name, value):
    """Return the address of a constant of the module. The linker merges equal constants."""
    constant = cgutils.global_constant(builder.module, builder.module.get_unique_name(name), value)
    constant.unnamed_addr = True
    return constant


def _lanes_of_bits():
    """Return a table that lists, for each mask of eight bits, the lanes that are set in ascending order.

    An entry is an int64 with one lane in each byte; the bytes after the last lane are arbitrary.
    """
    chosen = [[k for k in range(LANES) if mask >> k & 1] for mask in range(1 << LANES)]
    words = [sum(k << 8 * position for position, k in enumerate(lanes)) for lanes in chosen]
    return ir.Constant(ir.ArrayType(ir.IntType(64), len(words)), words)


@intrinsic
def compress(typingctx, vector, mask):
    def codegen(context, builder, sig, args):
        # A permutation from a table. LLVM's compress goes through memory without AVX-512: some 140
        # instructions a node, a quarter of the time of a ray. With AVX-512 the two are equally fast.
        i32, i64 = ir.IntType(32), ir.IntType(64)
        table = _constant(builder, "lanes_of_bits", _lanes_of_bits())
        which = builder.zext(builder.bitcast(args[1], ir.IntType(LANES)), i64)
        lanes = builder.load(builder.gep(table, [ir.Constant(i64, 0), which]))
        lanes = builder.zext(
            builder.bitcast(lanes, ir.VectorType(ir.IntType(8), LANES)), ir.VectorType(i32, LANES)
        )
        made = ir.Constant(LLVM[vector], ir.Undefined)
        for k in range(LANES):
            value = builder.extract_element(args[0], builder.extract_element(lanes, ir.Constant(i32, k)))
            made = builder.insert_element(made, value, ir.Constant(i32, k))
        return made

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
def like(typingctx, value, example):
    def codegen(context, builder, sig, args):
        if not isinstance(example, Vector):
            return args[0]
        return _splat(builder, args[0], LLVM[example])

    return example(example.element if isinstance(example, Vector) else example, example), codegen


def _converting(convert, vectors, scalars):
    """Return a function that converts between the float types of vectors or of plain numbers.

    *vectors*, *scalars*: source type and target type.
    """

    @intrinsic
    def function(typingctx, value):
        given, made = vectors if isinstance(value, Vector) else scalars

        def codegen(context, builder, sig, args):
            return convert(builder, args[0], context.get_value_type(made))

        return made(given), codegen

    return function


widen = _converting(ir.IRBuilder.fpext, (f32x8, f64x8), (types.float32, types.float64))
narrow = _converting(ir.IRBuilder.fptrunc, (f64x8, f32x8), (types.float64, types.float32))


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
    """Return the common float type of the operands. Integers and literals count as float64."""
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


def _lowest(context, builder, bounds, result_type):
    # Non-negative numbers order like their bits; the three lowest bits are replaced by the lane.
    i32 = ir.IntType(32)
    vector = ir.VectorType(i32, LANES)
    keys = builder.and_(builder.bitcast(bounds, vector), ir.Constant(vector, [~7] * LANES))
    keys = builder.or_(keys, ir.Constant(vector, list(range(LANES))))
    # In all lanes, so that the mask is computed without leaving the vectors.
    lowest = keys
    for step in (4, 2, 1):
        order = ir.Constant(vector, [i ^ step for i in range(LANES)])
        other = builder.shuffle_vector(lowest, ir.Constant(vector, ir.Undefined), order)
        lowest = builder.select(builder.icmp_unsigned("<", lowest, other), lowest, other)
    first = builder.and_(builder.extract_element(lowest, ir.Constant(i32, 0)), ir.Constant(i32, 7))
    it = builder.icmp_unsigned("==", keys, lowest)
    return context.make_tuple(builder, result_type, [builder.zext(first, ir.IntType(64)), it])


_LANE_AND_MASK = types.Tuple([types.int64, mask8])


@intrinsic
def halves_swapped(typingctx, vector):
    def codegen(context, builder, sig, args):
        return builder.shuffle_vector(
            args[0], ir.Constant(LLVM[vector], ir.Undefined), _order(4, 5, 6, 7, 0, 1, 2, 3)
        )

    return vector(vector), codegen


@intrinsic
def lowest_lane(typingctx, bounds):
    def codegen(context, builder, sig, args):
        return _lowest(context, builder, args[0], sig.return_type)

    return _LANE_AND_MASK(f32x8), codegen


@intrinsic
def nearest_lane(typingctx, bounds, mask):
    def codegen(context, builder, sig, args):
        infinite = ir.Constant(LLVM[f32x8], [float("inf")] * LANES)
        chosen = builder.select(args[1], args[0], infinite)
        return _lowest(context, builder, chosen, sig.return_type)

    return _LANE_AND_MASK(f32x8, mask8), codegen


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


def _each(combine):
    """Return a function of eight vectors that reduces each by *combine*.

    Lane i of the result is from the i-th vector.
    """

    @intrinsic
    def function(typingctx, a, b, c, d, e, f, g, h):
        ty = _common_type(a, b, c, d, e, f, g, h)

        def codegen(context, builder, sig, args):
            vectors = list(args)
            for step in (1, 2, 4):
                # Combine lanes that differ in the bit *step*; the two vectors share the remaining lanes.
                low = [i + (LANES - step if i & step else 0) for i in range(LANES)]
                orders = [
                    ir.Constant(ir.VectorType(ir.IntType(32), LANES), [i + shift for i in low])
                    for shift in (0, step)
                ]
                vectors = [
                    combine(
                        builder,
                        *(builder.shuffle_vector(vectors[k], vectors[k + 1], order) for order in orders),
                    )
                    for k in range(0, len(vectors), 2)
                ]
            return vectors[0]

        return ty(*[ty] * LANES), codegen

    return function


def _lesser(builder, a, b):
    return builder.select(builder.fcmp_ordered("<", a, b), a, b)


lane_sums = _each(lambda builder, a, b: builder.fadd(a, b))
lane_minima = _each(_lesser)
absolute = _unary("fabs")
square_root = _unary("sqrt")
