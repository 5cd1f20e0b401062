"""Layouts of messages for JavaScript and C#, compared with NumPy's by their texts alone."""

import re

import pytest
from javascript_layouts import assert_is_where_numpy_has_it, constant

from proximity.message.c_header import ENUMS, KINDS, RECORDS
from proximity.message.clients import EXAMPLES, client_files
from proximity.message.csharp_layout import csharp_enum, csharp_layout, pascal
from proximity.message.fields import dtype_of
from proximity.message.javascript_layout import layout_module, record_name


@pytest.mark.parametrize("name", RECORDS)
def test_every_field_of_javascript_is_where_numpy_has_it(name):
    assert_is_where_numpy_has_it(constant(layout_module(), "RECORDS")[name], dtype_of(RECORDS[name][1]))


def test_every_kind_and_member_of_javascript_is_that_of_python():
    kinds, enums = constant(layout_module(), "KINDS"), constant(layout_module(), "ENUMS")

    for kind in KINDS:
        assert kinds[kind.name]["magic"] == kind.magic
        assert kinds[kind.name]["header"] == record_name(kind.header)
        assert dtype_of(RECORDS[kinds[kind.name]["record"]][1]).itemsize == kind.record_size
    for values in ENUMS.values():
        assert enums[values.__name__] == {member.name: int(member) for member in values}


SIZES = {"byte": 1, "ushort": 2, "uint": 4, "int": 4, "ulong": 8, "long": 8, "double": 8, "DecaffVector": 24}


@pytest.mark.parametrize("name", RECORDS)
def test_every_field_of_csharp_is_where_numpy_has_it(name):
    """By the text alone: it holds where there is no compiler."""
    text, dtype = csharp_layout(), dtype_of(RECORDS[name][1])
    sizes = SIZES | {enum: SIZES[number] for enum, number in re.findall(r"public enum (\w+) : (\w+)", text)}
    size, body = re.search(
        rf"Size = (\d+)\)\]\n    public unsafe struct Decaff{pascal(name)}\n    {{\n(.*?)\n    }}", text, re.S
    ).groups()
    fields = re.findall(r"\[FieldOffset\((\d+)\)\] public (?:fixed )?(\w+) (\w+)(?:\[(\d+)\])?;", body)

    assert int(size) == dtype.itemsize
    assert [field[2] for field in fields] == [pascal(key) for key in dtype.names if key != "reserved"]
    for offset, kind, field, count in fields:
        part, expected = next(dtype.fields[key][:2] for key in dtype.names if pascal(key) == field)
        assert int(offset) == expected
        assert sizes[kind] * int(count or 1) == part.itemsize, field


def test_every_member_of_csharp_is_that_of_python():
    for values in ENUMS.values():
        body = re.search(rf"enum {csharp_enum(values)} : \w+\n    {{\n(.*?)\n    }}", csharp_layout(), re.S)[
            1
        ]
        found = dict(re.findall(r"^        (\w+) = (\d+),", body, re.M))
        expected = {pascal(member.name): str(int(member)) for member in values}
        assert found | expected == found and set(found) - set(expected) <= {"None"}


@pytest.mark.parametrize("language", ["csharp", "javascript", "cpp"])
def test_examples_are_short(language):
    examples = {name: text for name, text in client_files(language).items() if name in EXAMPLES}

    assert examples
    for name, text in examples.items():
        assert text.count("\n") <= 70, name
