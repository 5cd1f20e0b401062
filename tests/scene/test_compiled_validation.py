"""Compiled scenes with invalid contents and valid checksums are rejected or harmless."""

import json
import os
import re
import subprocess
import sys

import mutated_scenes
import numpy as np
import pytest
from project import IMPORT_PATHS, TRIALS

import proximity
from proximity import MeshFormatError
from proximity.kernels import layout
from proximity.kernels.scene.parts.part_trees import copies_in_use, copy_offsets
from proximity.scene.saved import archive, compiled_scene


@pytest.fixture(scope="module")
def contents(tmp_path_factory):
    path = tmp_path_factory.mktemp("scene") / "cell.prox"
    mutated_scenes.cell().save(path)
    return archive.read_archive(path, compiled_scene.LAYOUT)


@pytest.fixture
def refused(contents, tmp_path):
    """A function that changes the file, opens it, and returns the error message."""

    def load(change):
        arrays = {name: array.copy() for name, array in contents.arrays.items()}
        metadata = json.loads(json.dumps(contents.metadata))
        change(metadata, arrays)
        path = tmp_path / "changed.prox"
        archive.write_archive(path, metadata, arrays, compiled_scene.LAYOUT)
        with pytest.raises(MeshFormatError) as reason:
            proximity.load(path)
        begins = f"{path}: its contents are inconsistent ("
        ends = "); save the scene again with this version"
        told = str(reason.value)
        assert told.startswith(begins) and told.endswith(ends)
        return told[len(begins) : -len(ends)]

    return load


@pytest.mark.processes
@pytest.mark.parametrize(("name", "count"), [("cell", 500), ("crowd", 250), ("alone", 100), ("bodies", 150)])
def test_changed_file_is_refused_or_can_be_used(name, count, tmp_path):
    """Every column of every table and a thousand numbers are mutated; a crash would end the other process."""
    command = [sys.executable, TRIALS / "mutated_scenes.py", name, "0", str(count), tmp_path]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(IMPORT_PATHS)}
    result = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=280)
    lines = [json.loads(line) for line in result.stdout.splitlines()]
    assert result.returncode == 0, (lines[-1:], result.stderr)
    outcomes = [line for line in lines if len(line) == 3]
    assert len(outcomes) == count
    assert [line for line in outcomes if not line[2].startswith(("refused: ", "answered"))] == []
    assert {line[2].split(":")[0] for line in outcomes} == {"refused", "answered"}


def records(arrays, name):
    """View a table of a file as kernels read it."""
    return arrays[name].view({"parts": layout.PART, "frames": layout.FRAME}[name]).reshape(-1)


def word(row, column, offset, value):
    """Mutate the word at *offset* from the position in a column of a part's row."""

    def change(metadata, arrays):
        arrays["words"].view(np.int32)[records(arrays, "parts")[column][row] + offset] = value

    return change


def child(row, node, lane, value):
    """Mutate a child reference in a part's tree, or in the tree of static parts (-1)."""

    def change(metadata, arrays):
        root = records(arrays, "parts")["root" if row >= 0 else "static_root"][row]
        at = layout.NODE_STRIDE * (root + node) + layout.NODE_CHILDREN + lane
        arrays["words"].view(np.int32)[at] = value

    return change


def number(name, row, column, value):
    """Mutate a number in a table."""

    def change(metadata, arrays):
        table = records(arrays, name) if isinstance(column, str) else arrays[name].T
        table[column][row] = value

    return change


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (child(1, 0, 0, 9000), r"part 1 'with a hole': child 0 of node 0 refers to node \d+, expected"),
        (child(1, 0, 0, 1), r"part 1 'with a hole': child 0 of node 0 refers to node 0, expected"),
        (child(1, 0, 0, ~2**20), r"part 1 'with a hole': child 0 of node 0 refers to block \d+, expected"),
        (child(-1, 0, 0, 7), r"the trees over the parts: child 0 of node 0 refers to 7, where"),
        (child(-1, 0, 0, ~(layout.ENTRY + 500)), r"the trees over the parts: child 0 of node 0 refers to -"),
        (word(0, "slot_faces", 0, 12), r"part 0 'cube': slot 0 holds face 12, but there are 12"),
        (word(0, "block_notes", 0, 1), r"part 0 'cube': block 0 is noted as another part's"),
        (word(0, "block_boxes", 0, -1), r"part 0 'cube': the oriented box of block 0 lies outside of"),
        (word(0, "faces", 0, 8), r"part 0 'cube': face 0 refers to corner 8, but there are 8"),
        (word(0, "neighbors", 0, -3), r"part 0 'cube': face 0 has face -3 for a neighbour, but"),
        (word(0, "grid", 0, -1), r"part 0 'cube': its sign grid has cells of no known state"),
        (word(-1, "grid", 0, 0), r"the trees over the parts: cell 0 of the grid over the parts"),
        (number("parts", 2, "corners", 2**40), r"the table of parts has a number "),
        (number("parts", 0, "sign", 3), r"a part has no known kind of sign"),
        (number("parts", 0, "sign", 2), r"part 0 'cube' has other faces, or another sign, than"),
        (number("parts", -1, "super_node", 0), r"the tree over moved parts is at none of its"),
        (number("frames", 0, "scale", 3.0), r"a local frame is not scaled by a power of two"),
        (number("poses", 1, 0, 0.5), r"the pose of part 1 is no rigid transform"),
        (number("faces", 3, 1, 8), r"part 0 'cube': face 3 of its mesh refers to vertex 8, but there are 8"),
    ],
    ids=lambda value: value[:40] if isinstance(value, str) else "",
)  # fmt: skip
def test_reference_to_what_is_not_there_is_told(change, told, refused):
    assert re.match(told, refused(change))


@pytest.mark.parametrize(
    ("field", "value", "told"),
    [
        ("name", ["a", "a", "b", "c", "d"], "two parts have one name"),
        ("name", ["a", 7, "b", "c", "d"], "entry 1 of names is 7, expected str"),
        ("velocity", [[0.0, 0.0, float("nan")]] * 5, "velocity of part 0 are not finite, or too fast"),
        ("is_hidden", [0] * 5, "entry 0 of is_hidden is 0, expected bool"),
        # It is missing in the tree over the parts, so that no query would find it.
        ("is_hidden", [False] * 5, "part 4 'hidden': block 0 is missing in the tree over the parts"),
        ("stiffness", [-1.0] * 5, "stiffness of part 'cube' is -1.0, expected a positive number of N/m"),
        ("repairs", [{}] * 5, "repairs are {}"),
    ],
)
def test_field_of_another_type_or_range_is_told(field, value, told, refused):
    assert refused(lambda metadata, arrays: metadata["parts"].update({field: value})).startswith(told)


def test_what_follows_from_other_numbers_is_made_anew(contents, tmp_path):
    """Derived data may have any value: boxes of parts, flags, and the tree of moved parts."""
    arrays = {name: array.copy() for name, array in contents.arrays.items()}
    parts, frames = records(arrays, "parts"), records(arrays, "frames")
    parts["is_turned"], parts["is_fused"] = 1 - parts["is_turned"], 1 - parts["is_fused"]
    parts["is_hidden"][:-1] = 1
    parts[-1]["root"] = parts[-1]["dynamic_count"] = 10**3
    frames["box_lower"] = frames["box_upper"] = 7.0
    frames["rotation"][:-1] = frames["translation"][:-1] = 2.0
    region, (_, static) = parts["super_node"][-1], copies_in_use(parts)
    children = layout.NODE_STRIDE * region + layout.NODE_CHILDREN + np.arange(layout.LANES)
    arrays["words"].view(np.int32)[children] = 10**3
    entry = copy_offsets(parts, static)[1] + 2 * parts["entry_count"][-1]
    arrays["words"].view(np.int32)[entry : entry + 2] = 10**3
    path, again = tmp_path / "changed.prox", tmp_path / "again.prox"
    archive.write_archive(path, contents.metadata, arrays, compiled_scene.LAYOUT)
    proximity.load(path).save(again)
    for name, array in archive.read_archive(again, compiled_scene.LAYOUT).arrays.items():
        assert array.tobytes() == contents.arrays[name].tobytes(), name
