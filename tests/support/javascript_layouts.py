"""Message layouts for JavaScript, parsed from source text and compared with NumPy's."""

import json
import re

from proximity.message.javascript_layout import TEXT, VIEWS


def constant(text, name):
    """Parse a constant of an ES module of layouts as JSON."""
    return json.loads(re.search(rf"export const {name} = (.*?);\n(?=export|$)", text, re.S)[1])


def assert_is_where_numpy_has_it(record, dtype):
    """Compare every field of a record of ``RECORDS`` with the same field of a NumPy type."""
    assert record["size"] == dtype.itemsize
    assert list(record["fields"]) == list(dtype.names)
    for field, (part, offset) in ((key, dtype.fields[key][:2]) for key in dtype.names):
        found = record["fields"][field]
        assert found["offset"] == offset
        if part.kind == "S":
            assert (found["type"], found["count"]) == (TEXT, part.itemsize)
            continue
        assert found["type"] == VIEWS[part.base.str[1:]]
        assert found["count"] * found["size"] == part.itemsize
