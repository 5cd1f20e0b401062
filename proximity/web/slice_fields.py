"""What travels between bridge and page alone: a slice of the signed distance."""

from proximity.message.fields import VECTOR, Field, dtype_of

SLICE_MAGIC = 0x4C434544  # "DECL"
SLICE_FIELDS = (
    Field("magic", "<u4", "", "SLICE_MAGIC"),
    Field("ticket", "<u4", "", "what the page asked with"),
    Field("width", "<u4", "", "points along u"),
    Field("height", "<u4", "", "points along v; width times height float32 follow, m, row by row"),
    Field("origin", "<f8", "m", "the first point", VECTOR),
    Field("u", "<f8", "m", "from the first point of a row to the last", VECTOR),
    Field("v", "<f8", "m", "from the first row to the last", VECTOR),
    Field("lowest", "<f8", "m", "least of the distances"),
    Field("highest", "<f8", "m", "largest of them"),
)
SLICE_HEADER = dtype_of(SLICE_FIELDS)
"""The header of a slice, 104 bytes."""
