"""Arrays that a kernel needs for itself: on the stack, with anything in them.

So no kernel owns an array or counts references to one: counting was a tenth of the time of a call with five
points and a fifth of a tick's.
"""

import numpy as np

from proximity.native import IS_JIT

if IS_JIT:
    from proximity.kernels.compiled_stack import arrays_here, bundle_here, reals_of
else:  # plain Python, to step through; in code that was compiled ahead of time nobody calls them from here

    def arrays_here(dtype):
        return lambda count: np.empty(count, dtype), lambda count, columns: np.empty((count, columns), dtype)

    def reals_of(records):
        return records.view(np.float64).reshape(len(records), -1)

    def bundle_here(bundle, *columns):
        return lambda: bundle(*(np.empty(lengths, dtype) for dtype, *lengths in columns))


reals_here, real_rows_here = arrays_here("float64")
words_here, word_rows_here = arrays_here("float32")
longs_here, long_rows_here = arrays_here("int64")
"""Functions of a constant count, or of two, rows and columns: an array that lasts as long as the caller runs.
The caller must be a function that is called, not one that is put into another: such memory may be something
else's as soon as it returns. To make rows of an array that is there would take longer than a step of a walk.
`bundle_here` makes such a function for a named tuple of arrays: of each the dtype and constant lengths."""
