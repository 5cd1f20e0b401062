"""Scratch arrays of kernels, on the stack and uninitialized.

They keep kernels from owning arrays and counting references: counting took a tenth of a call with five points
and a fifth of a tick.
"""

import numpy as np

from proximity.native import IS_JIT

if IS_JIT:
    from proximity.kernels.compiled_stack import reals_of, rows_of_three, stack_arrays_of, stack_bundle
else:  # interpreted, for stepping through; code compiled ahead of time does not use these

    def stack_arrays_of(dtype):
        return lambda count: np.empty(count, dtype), lambda count, columns: np.empty((count, columns), dtype)

    def reals_of(records):
        return records.view(np.float64).reshape(len(records), -1)

    def rows_of_three(numbers, start, count):
        return numbers[start : start + 3 * count].reshape(count, 3)

    def stack_bundle(bundle, *columns):
        return lambda: bundle(*(np.empty(lengths, dtype) for dtype, *lengths in columns))


stack_f64, stack_f64_rows = stack_arrays_of("float64")
stack_f32, stack_f32_rows = stack_arrays_of("float32")
_, stack_i32_rows = stack_arrays_of("int32")
stack_i64, stack_i64_rows = stack_arrays_of("int64")
"""Functions of a constant count, or of rows and columns, returning an array valid until the caller returns.
The caller must be a called function, not an inlined one: the memory may be reused afterwards. Creating views
of rows of an existing array would take longer than a step of a walk. `stack_bundle` makes such a function for
a named tuple of arrays, each given by dtype and constant lengths."""
