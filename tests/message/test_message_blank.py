"""Blank records in every language: fields that a sender omits are not a hand at rest."""

import math

import numpy as np
import pytest
from client_programs import build
from compiling_c import WARNINGS, c_compiler, compiler, run

from proximity.message import (
    ADDITIONS,
    DEFORMATIONS,
    GLOVE_POSES,
    MEASURED,
    MOVES,
    PATH_POSES,
    POSES,
    Message,
)
from proximity.message.c_header import SENT, header_text, record_name
from proximity.message.csharp_layout import csharp_layout

KINDS = (POSES, PATH_POSES, GLOVE_POSES, MOVES, MEASURED, ADDITIONS, DEFORMATIONS)
FIRST_ROWS = ("corners", "vertices")
"""Fields of which C sets only the first row, which marks the table as empty."""


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_record_of_python_begins_as_not_given(kind):
    for record in Message(kind, 2).records:
        for name in kind.record.names:
            if name == "rotation":
                assert record[name].tolist() == np.eye(3).tolist()
            elif kind.record[name].base.kind == "f" and name not in kind.zeros:
                assert np.isnan(record[name]).all(), name
            else:
                assert not np.any(record[name] != np.zeros_like(record[name])), name


def printed_fields(record, kind):
    """Return lines of C that print each real of a record, and the first row of tables."""
    for name in kind.record.names:
        if kind.record[name].base.kind == "f":
            count = 3 if name in FIRST_ROWS else math.prod(kind.record[name].shape)
            yield f"for (i = 0; i < {count}; i++)"
            yield f'    printf("%g ", ((const double *)&{record}.{name})[i]);'


def expected_fields():
    for kind in KINDS:
        for name in kind.record.names:
            if kind.record[name].base.kind == "f":
                values = kind.blank[name].ravel().tolist()
                yield from values[:3] if name in FIRST_ROWS else values


@pytest.mark.parametrize("language", ["c", "cpp"])
def test_records_of_c_and_cpp_begin_as_those_of_python(language, tmp_path):
    (tmp_path / "proximity_message.h").write_text(header_text(), encoding="ascii")
    lines = []
    for name, kind in zip(SENT, KINDS, strict=True):
        begin = f" = {record_name(name).upper()}_INIT" if language == "c" else "{}"
        lines += ["{", f"{record_name(name)} record{begin};", *printed_fields("record", kind), "}"]
    source = tmp_path / f"begin.{language}"
    body = "\n".join(
        ["#include <stdio.h>", '#include "proximity_message.h"', "int main(void) {", "int i;", *lines]
    )
    source.write_text(body + "\nreturn 0; }\n")
    program = [c_compiler(), "-std=c99"] if language == "c" else [compiler("c++", "g++"), "-std=c++11"]
    run(*program, *WARNINGS, source, "-lm", "-o", tmp_path / "begin")

    told = [float(word) for word in run(tmp_path / "begin").split()]

    np.testing.assert_array_equal(told, list(expected_fields()))


def test_records_of_javascript_begin_as_those_of_python(tmp_path):
    source = tmp_path / "begin.mjs"
    source.write_text("""
import { encode, poseOf } from "./proximity_client.mjs";
const header = { send_ns: 0n, session: 0n, sequence: 0n };
const show = (bytes) => console.log(Buffer.from(bytes).toString("hex"));
for (const kind of process.argv.slice(2)) show(encode(kind, header, [{}]));
show(encode("poses", header, [poseOf(1, [1, 2, 3], 4n)]));
""")
    program = build("javascript", tmp_path, source, "begin")
    *told, pose = run(*program, *(kind.name for kind in KINDS)).split()

    for kind, text in zip(KINDS, told, strict=True):
        (record,) = np.frombuffer(bytes.fromhex(text), kind.record, offset=kind.header_size)
        for name in kind.record.names:
            np.testing.assert_array_equal(record[name], kind.blank[name])
    (record,) = np.frombuffer(bytes.fromhex(pose), POSES.record, offset=POSES.header_size)
    assert record["position"].tolist() == [1, 2, 3] and np.isnan([*record["velocity"], record["bend"]]).all()


def test_records_of_csharp_have_a_beginning_that_gives_nothing():
    text = csharp_layout()

    for name in SENT:
        record = "Proximity" + "".join(word.capitalize() for word in name.split("_"))
        assert f"public static {record} Begin()" in text
    assert "r.Rotation[0] = r.Rotation[4] = r.Rotation[8] = 1;" in text
    assert "for (int i = 0; i < 195; i++) r.Corners[i] = double.NaN;" in text
    assert "r.Bend = double.NaN;" in text
