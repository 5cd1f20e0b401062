"""Open and query mutated compiled scenes whose checksums are valid; run as a separate process.

``python mutated_scenes.py SCENE FIRST COUNT FOLDER`` prints a line per mutation: number, description and
outcome. A crash or an endless loop ends the process.
"""

import contextlib
import copy
import json
import os
import signal
import sys
import zlib
from pathlib import Path

import numpy as np
import shapes

import proximity
from proximity import Part, Pose, Scene, Solid
from proximity.kernels import layout
from proximity.scene.saved import archive, compiled_scene

MAX_S = 20
"""Time limit of one mutation."""
NOON_NS = 12 * 3600 * 10**9


def cell():
    """A few small parts: one with a sign grid, one with a hole, a sheet; one moved, one hidden."""
    ball, faces = shapes.sphere(0.02, 1)
    scene = Scene(
        [
            Solid(*shapes.cube(0.02), name="cube"),
            Solid(*shapes.moved((ball, faces[1:]), (0.05, 0.0, 0.0)), name="with a hole"),
            Part(
                "sheet",
                Solid(*shapes.grid(2, 2)),
                Pose(translation=(0, 0, 0.1)),
                np.arange(8, dtype=np.int32),
            ),
            Solid(*shapes.moved(shapes.torus(0.02, 0.006, 10, 6), (0.0, 0.06, 0.0)), name="torus"),
            Solid(*shapes.moved(shapes.octahedron(0.01), (0.0, 0.0, 0.03)), name="hidden"),
        ]
    )
    scene.move("torus", Pose(shapes.rotation(1), (0.01, 0.02, 0.0)), velocity=(0.1, 0.0, 0.0))
    scene.hide("hidden")
    return scene


def crowd():
    """As many moved parts as need their own nodes, and an equal number of static ones."""
    solids = [
        Solid(*shapes.cube(0.01)),
        Solid(*shapes.sphere(0.01, 0)),
        Solid(*shapes.torus(0.01, 0.003, 6, 4)),
    ]
    spots = np.random.default_rng(2).uniform(-0.1, 0.1, (24, 3))
    scene = Scene(
        [
            Part(f"part {row}", solids[row % 3], Pose(translation=spot),
                 np.arange(solids[row % 3].mesh.face_count, dtype=np.int32))
            for row, spot in enumerate(spots)
        ]
    )  # fmt: skip
    for row in range(0, 24, 2):
        scene.move(f"part {row}", Pose(shapes.rotation(row), spots[row] + 0.01))
        scene.distance((0.0, 0.0, 0.0))
    return scene


def alone():
    """One rotated and deformed part."""
    vertices, faces = shapes.sphere(0.02, 2)
    scene = Scene([Solid(vertices, faces, name="ball")])
    scene.move("ball", Pose(shapes.rotation(4), (0.1, 0.2, 0.3)))
    scene.deform("ball", vertices * (1.0, 1.2, 0.8))
    return scene


def bodies():
    """Parts with a common frame, traversed as one tree."""
    mesh = shapes.join(
        *(shapes.moved(shapes.hollow_cube(0.03, 0.01), (0.04 * k, 0.0, 0.0)) for k in range(4))
    )
    return Scene.from_mesh(*shapes.soup(*mesh), name="row")


SCENES = {make.__name__: make for make in (cell, crowd, alone, bodies)}


def runs(arrays):
    """Find the offset of each table within the words, by name."""
    parts = arrays["parts"].view(layout.PART).reshape(-1)
    row = parts[0]
    nodes, blocks = parts["node_count"][:-1].sum(), parts["block_count"][:-1].sum()
    found = {
        "nodes": (0, layout.NODE_STRIDE * nodes),
        "trees over parts": (layout.NODE_STRIDE * nodes, row["slot_faces"]),
        "slots": (row["slot_faces"], row["slot_faces"] + layout.LANES * blocks),
        "moments": (row["moments"], row["moments"] + compiled_scene.LAYOUT["MOMENT_STRIDE"] * nodes),
        "boxes": (row["block_boxes"], row["block_boxes"] + layout.ORIENTED_STRIDE * blocks),
        "notes": (row["block_notes"], row["block_notes"] + blocks),
        "grid over parts": (parts["grid"][-1], len(arrays["words"])),
    }
    for what in ("faces", "neighbors"):
        found[what] = (row[what], row[what] + 3 * row["face_count"])
    if row["grid"] >= 0:
        found["grid"] = (row["grid"], row["grid"] + 8)
    return {what: (int(first), int(end)) for what, (first, end) in found.items() if end > first}


def other_value(rng, old, values):
    """Replace *old*, one of *values*, by another value of the same type."""
    kind = values.dtype.type
    if rng.random() < 0.25:
        return values[rng.integers(len(values))]
    if values.dtype.kind == "i":
        limits = np.iinfo(kind)
        choices = [
            old + 1,
            old - 1,
            0,
            -1,
            -2,
            1,
            7,
            8,
            len(values),
            2**29,
            ~(2**29),
            ~int(old),
            -int(old),
            2 * int(old),
            1000,
            -1000,
            limits.max,
            limits.min,
            int(rng.integers(-(2**20), 2**20)),
        ]
        return kind(np.clip(choices[rng.integers(len(choices))], limits.min, limits.max))
    choices = [
        np.nan,
        np.inf,
        -np.inf,
        0.0,
        -0.0,
        -old,
        2.0 * old,
        old + 1e-3,
        1e30,
        -1e30,
        1e-30,
        1.0,
        -1.0,
        rng.normal(),
        old * (1.0 + 1e-6),
        np.finfo(kind).max,
        np.finfo(kind).tiny,
    ]
    with np.errstate(all="ignore"):
        return kind(choices[rng.integers(len(choices))])


def change_array(rng, arrays, number):
    """Change one number of an array, cycling through the part table's columns and the tables of words."""
    names = [
        "parts", "words", "words", "frames", "reals", "words", "faces", "vertices", "poses", "source_faces",
    ]  # fmt: skip
    name = names[number % len(names)]
    array = arrays[name]
    if name == "words":
        tables = runs(arrays)
        what = list(tables)[number // len(names) % len(tables)]
        first, end = tables[what]
        at = int(rng.integers(first, end))
        if what in ("nodes", "trees over parts") and rng.random() < 0.6:
            # Child references, which are a quarter of a node.
            at = at // layout.NODE_STRIDE * layout.NODE_STRIDE + layout.NODE_CHILDREN + int(rng.integers(16))
        is_real = what == "moments" or (
            what in ("nodes", "trees over parts") and at % 64 < layout.NODE_CHILDREN
        )
        values = array[first:end].view(np.float32 if is_real else np.int32)
        at -= first
    else:
        what = name
        values = array.reshape(-1)
        at = int(rng.integers(values.size))
        if name in ("parts", "frames"):
            columns = array.shape[1]
            at = at // columns * columns + number // len(names) % columns
    old = values[at].item()
    values[at] = other_value(rng, old, values)
    return f"{what}[{at}] {old} -> {values[at]}"


def change_metadata(rng, metadata):
    """Change one value of the description."""
    paths = []

    def visit(value, path):
        paths.append(path)
        items = (
            value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
        )
        for key, below in items:
            visit(below, (*path, key))

    visit(metadata, ())
    path = paths[rng.integers(1, len(paths))]
    holder = metadata
    for key in path[:-1]:
        holder = holder[key]
    choices = [
        None,
        True,
        -1,
        0,
        1,
        2**31,
        10**30,
        1.5,
        float("nan"),
        float("inf"),
        "",
        "x",
        [],
        {},
        [1, 2, 3],
        [[]],
        {"name": 1},
    ]
    value = choices[rng.integers(len(choices))]
    if rng.random() < 0.2 and isinstance(holder, dict):
        del holder[path[-1]]
        return f"{path} deleted"
    holder[path[-1]] = value
    return f"{path} -> {value!r}"


def changed(number, name, metadata, arrays):
    """Return metadata and arrays with mutation *number*, and its description."""
    rng = np.random.default_rng([number, *name.encode()])
    metadata, arrays = copy.deepcopy(metadata), {key: array.copy() for key, array in arrays.items()}
    if number % 7 == 6:
        return metadata, arrays, change_metadata(rng, metadata)
    times = 1 if rng.random() < 0.8 else int(rng.integers(2, 5))
    return metadata, arrays, "; ".join(change_array(rng, arrays, number + 13 * k) for k in range(times))


def rewrite_text(path, old, new):
    """Replace the first *old* in the description of a saved scene and update the checksums."""
    data = path.read_bytes()
    fields = list(archive.HEADER.unpack_from(data))
    text = data[archive.HEADER.size : archive.HEADER.size + fields[4]]
    written = text.rstrip().replace(old, new, 1)
    assert written != text.rstrip() and len(written) <= len(text)
    fields[5] = zlib.crc32(written := written.ljust(len(text)))
    header = archive.HEADER.pack(*fields[:-1], 0)[:-4]
    path.write_bytes(
        header + zlib.crc32(header).to_bytes(4, "little") + written + data[archive.HEADER.size + len(text) :]
    )


def ask(asked, points):
    """Run every query; check that the faces and parts reported exist."""
    for rows in (points, points[:3]):
        for found in (
            asked.closest(rows),
            asked.closest(rows, max_distance=0.01),
            asked.cast(rows, rows[::-1] + 0.01),
            asked.closest_to_segments(rows, rows[::-1]),
        ):
            assert found.face_id.shape == (len(rows),) and (found.face_id >= -1).all()
            assert (found.face_id < 2**20).all()
        assert asked.distance(rows).shape == (len(rows),)
        assert asked.cast_distance(rows, rows + 0.01).shape == (len(rows),)
        for question in (asked.signed_distance, asked.contains):
            with contextlib.suppress(proximity.NotWatertightError):
                assert question(rows).shape == (len(rows),)


def use(scene, path):
    """Call every method of a scene and of its trackers, and save it again."""
    points = np.random.default_rng(1).uniform(-0.12, 0.12, (20, 3))
    points[-1] = (1e3, 0.0, 0.0)
    ask(scene, points)
    tracker = proximity.Tracker(scene, fingers=2, radius=0.005)
    for step in range(3):
        now_ns = NOON_NS + step * 10**6
        tracker.tick(points[step : step + 2], now_ns, now_ns)
    for part in scene.parts:
        ask(part.solid, points[:4])
    first = scene.parts[0]
    scene.move(first.name, Pose(shapes.rotation(3), (0.02, 0.01, 0.0)))
    scene.hide(scene.parts[-1].name)
    ask(scene, points)
    for part in scene.parts:
        scene.show(part.name)
    ask(scene, points)
    with contextlib.suppress(proximity.MeshError):
        scene.deform(first.name, first.solid.mesh.vertices * 1.1)
    ask(scene, points)
    ask(first.solid, points[:4])
    tracker.tick(points[:2], NOON_NS + 10**9, NOON_NS + 10**9)
    scene.save(path)


def outcome(path):
    """Open a file, use its scene and return the outcome."""
    try:
        scene = proximity.load(path)
    except proximity.MeshFormatError as refused:
        return f"refused: {refused}"
    use(scene, path.with_name("again.prox"))
    return "answered"


def main(name, first, count, folder):
    """Run *count* mutations from number *first*."""
    # Use the unmutated scene first, which also compiles all kernels.
    path = prepared(name, folder)
    use(proximity.load(path), path.with_name("again.prox"))
    for number, what in changes(path, name, first, count):
        print(json.dumps([number, what]), flush=True)
        print(json.dumps([number, what, told(outcome, path)]), flush=True)


def prepared(name, folder):
    """Save a scene; return its file."""
    os.fsync = lambda number: None  # it dominates the run time
    # A timeout ends the process by the signal.
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    path = Path(folder) / "changed.prox"
    SCENES[name]().save(path)
    return path


def changes(path, name, first, count):
    """Write one mutation after another to the file; yield their numbers and descriptions."""
    contents = archive.read_archive(path, compiled_scene.LAYOUT)
    metadata, arrays = contents.metadata, {key: array.copy() for key, array in contents.arrays.items()}
    for number in range(first, first + count):
        *altered, what = changed(number, name, metadata, arrays)
        archive.write_archive(path, *altered, compiled_scene.LAYOUT)
        yield number, what


def told(ask, *arguments):
    """Return the result of *ask*, or the error it raised, within the time limit."""
    signal.alarm(MAX_S)
    try:
        outcome_of_it = ask(*arguments)
    except Exception as unexpected:
        outcome_of_it = f"raised: {type(unexpected).__name__}: {unexpected}"
    signal.alarm(0)
    return outcome_of_it


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), sys.argv[4])
