"""The engine for browsers, in Node: bit-identical to Python, moves, trackers, and errors."""

import json
import os
import re
import shutil
import subprocess

import numpy as np
import pytest
from given_meshes import NAMED, torn
from pages import PAGES
from project import MESHES, SUPPORT

import proximity
from benchmarks.digest import queries, scenes
from benchmarks.digest.library_program import through_program
from proximity.cli.service import sources
from proximity.clients import wasm_package

NODE = shutil.which("node")
pytestmark = [
    pytest.mark.filterwarnings("ignore::proximity.UnitsWarning"),  # some points are far away on purpose
    pytest.mark.skipif(NODE is None, reason="there is no Node"),
    pytest.mark.skipif(
        not all((wasm_package.NATIVE / name).is_file() for name in wasm_package.MODULES),
        reason="the engine for browsers is not compiled",
    ),
]
RELAXED = "--experimental-wasm-relaxed-simd"  # the default since Node 21


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The package and a scene."""
    made = tmp_path_factory.mktemp("wasm")
    written = wasm_package.write_package(made)
    assert all(written.values()) and (made / "proximity.d.ts").is_file()
    proximity.load(MESHES / "assembly.glb").save(made / "assembly.prox")
    return made


def run(folder, *words):
    """Run Node in a folder; return its output."""
    done = subprocess.run([NODE, RELAXED, *words], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def run_module(folder, code):
    """Run code that imports the engine; return its output, parsed as JSON."""
    (folder / "code.mjs").write_text('import { load, ProximityError } from "./proximity.mjs";\n' + code)
    return json.loads(run(folder, "code.mjs"))


def served(folder, scene, instructions):
    command = [NODE, RELAXED, str(SUPPORT / "clients" / "module_server.mjs"), str(folder), instructions]
    return through_program(scene, command)


@pytest.mark.parametrize("name", ["bracket.stl", "assembly.glb", "gear.stl"])
def test_answers_are_those_of_python_to_the_bit(folder, name):
    scene = proximity.load(MESHES / name)
    triangles = queries.triangles_of(scene)

    expected = dict(queries.digests_of(name, scene, triangles, 3000, 1))
    asked = dict(queries.digests_of(name, served(folder, scene, "relaxed"), triangles, 3000, 1))

    assert asked == expected and len(asked) >= 5


def test_moved_and_hidden_parts_are_answered_to_the_bit(folder):
    rng = scenes.generator("wasm")
    scene = scenes.random_scene(rng, 12, 0.05, 0.0)
    scenes.change_scene(scene, rng, 0.05)
    triangles = queries.triangles_of(scene)

    expected = dict(queries.digests_of("changed", scene, triangles, 2000, 1))

    assert (
        dict(queries.digests_of("changed", served(folder, scene, "relaxed"), triangles, 2000, 1)) == expected
    )


def test_parts_are_ignored_as_in_python(folder):
    scene, rng = proximity.load(folder / "assembly.prox"), np.random.default_rng(12)
    lower, upper = scene.bounds
    points, others = rng.uniform(lower - 0.01, upper + 0.01, (2, 60, 3))
    names, ticks = [part.name for part in scene.parts], []
    chosen = [rng.permutation(names)[:count].tolist() for count in range(5)]
    tracker, where = proximity.Tracker(scene, fingers=4), points[:4].copy()
    for k in range(100):
        where += rng.uniform(-1e-3, 1e-3, where.shape)
        change = int(rng.integers(4)), str(rng.choice(names)), bool(rng.integers(2))
        tracker.ignore(*change)
        now = 10**9 + 10**6 * k
        contacts = tracker.tick(where, now, now)
        told = {name: contacts[name].tolist() for name in ("lower", "upper", "part", "face")}
        ticks.append({"where": where.reshape(-1).tolist(), "change": change, "told": told})
    given = {"points": points.reshape(-1).tolist(), "others": others.reshape(-1).tolist()}
    given |= {"chosen": chosen, "ticks": ticks}
    (folder / "ignoring.json").write_text(json.dumps(given).replace("Infinity", "1e999"))

    told = run_module(
        folder,
        """
const { readFileSync } = await import("node:fs");
const scene = (await load()).open(readFileSync("assembly.prox"));
const { points, others, chosen, ticks } = JSON.parse(readFileSync("ignoring.json"));
const texts = ([name, list]) => [name, Array.from(list, String)];
const plain = (answers) => Object.fromEntries(Object.entries(answers).map(texts));
const one = (found) => plain({ found });
const asked = chosen.map((ignore) => [
  plain(scene.closest(points, { ignore })),
  one(scene.signedDistance(points, undefined, { ignore })),
  one(scene.distance(points, undefined, { ignore })),
  one(scene.contains(points, { ignore })),
  plain(scene.cast(points, others, { ignore })),
  one(scene.castDistance(points, others, { ignore })),
  plain(scene.closestToSegments(points, others, { ignore, maxDistance: 0.01 })),
]);
const single = scene.distance(points, undefined, { ignore: chosen[1][0] });
const isOne = String(single) === asked[1][2].found.join();
const tracker = scene.tracker(4);
const differing = ticks.findIndex(({ where, change, told }, tick) => {
  const now = 1000000000n + 1000000n * BigInt(tick);
  tracker.ignore(...change);
  const contacts = tracker.tick(where, now, now);
  const differs = (name) => told[name].some((value, k) => contacts[k][name] !== value);
  return Object.keys(told).some(differs);
});
let sentence = "";
try { tracker.ignore(0, "none"); } catch (error) { sentence = error.message; }
console.log(JSON.stringify({ asked, isOne, differing, sentence }));
""",
    )
    for ignore, (closest, signed, distance, inside, hits, along, segments) in zip(
        chosen, told["asked"], strict=True
    ):
        expected = scene.closest(points, ignore=ignore)
        assert np.array_equal(numbers(closest["signedDistance"]), expected.signed_distance)
        assert np.array_equal(numbers(closest["point"]), expected.point.reshape(-1), equal_nan=True)
        assert np.array_equal(numbers(closest["part"]), expected.part)
        assert np.array_equal(numbers(signed["found"]), scene.signed_distance(points, ignore=ignore))
        assert np.array_equal(numbers(distance["found"]), scene.distance(points, ignore=ignore))
        assert np.array_equal(numbers(inside["found"]), scene.contains(points, ignore=ignore))
        expected = scene.cast(points, others, ignore=ignore)
        assert np.array_equal(numbers(hits["distance"]), expected.distance)
        assert np.array_equal(numbers(hits["normal"]), expected.normal.reshape(-1), equal_nan=True)
        assert np.array_equal(numbers(along["found"]), expected.distance)
        expected = scene.closest_to_segments(points, others, max_distance=0.01, ignore=ignore)
        assert np.array_equal(numbers(segments["distance"]), expected.distance)
        assert np.array_equal(numbers(segments["part"]), expected.part)
    assert told["isOne"] and told["differing"] == -1
    assert "there is no part" in told["sentence"]


def numbers(texts):
    return np.array([float(text.replace("Infinity", "inf")) for text in texts])


def test_without_relaxed_instructions_answers_differ_by_rounding_alone(folder):
    scene = proximity.load(MESHES / "bracket.stl", units="mm")
    lower, upper = scene.bounds
    points = np.random.default_rng(4).uniform(lower - 0.01, upper + 0.01, (20_000, 3))

    plain = served(folder, scene, "plain").signed_distance(points)

    expected = scene.signed_distance(points)
    assert np.array_equal(np.sign(plain), np.sign(expected))
    np.testing.assert_allclose(plain, expected, rtol=0, atol=1e-15)


def test_parts_move_and_hide_as_in_python(folder):
    told = run_module(
        folder,
        """
const { readFileSync } = await import("node:fs");
const scene = (await load()).open(readFileSync("assembly.prox"));
const points = [0.1, 0.2, 0.3, 0, 0, 0];
const before = scene.signedDistance(points);
const pose = scene.pose(scene.parts[0]);
pose[3] += 0.25;
scene.move([{ part: scene.parts[0], matrix: pose, velocity: [1, 0, 0] }]);
const moved = Array.from(scene.signedDistance(points));
scene.hide(scene.parts[0]);
const hidden = Array.from(scene.signedDistance(points));
const { lower, upper } = scene.bounds;
console.log(JSON.stringify({ parts: scene.parts, before: Array.from(before), moved, hidden,
  isHidden: scene.isHidden(0), faces: scene.faceCount(0), instructions: scene.instructions,
  bounds: [Array.from(lower), Array.from(upper)] }));
""",
    )
    scene, points = proximity.load(folder / "assembly.prox"), np.array([[0.1, 0.2, 0.3], [0.0, 0.0, 0.0]])
    first = scene.parts[0]
    assert told["parts"] == [part.name for part in scene.parts]
    assert told["before"] == scene.signed_distance(points).tolist()
    matrix = first.pose.matrix.copy()
    matrix[0, 3] += 0.25
    scene.move(first.name, matrix, velocity=[1, 0, 0])
    assert told["moved"] == scene.signed_distance(points).tolist()
    scene.hide(first.name)
    assert told["hidden"] == scene.signed_distance(points).tolist()
    assert told["bounds"] == [corner.tolist() for corner in scene.bounds]
    assert told["isHidden"] and told["faces"] == first.solid.mesh.face_count
    assert told["instructions"] == "relaxed"


def test_scenes_of_meshes_are_those_of_python(folder):
    rng = np.random.default_rng(4)
    meshes = {**NAMED, **{f"torn {name}": torn(name, 1) for name in ("hollow", "touching", "voxels")}}
    python = {name: proximity.Scene.from_mesh(*mesh) for name, mesh in meshes.items()}
    points = {name: rng.uniform(*scene.bounds, (60, 3)) for name, scene in python.items()}
    given = [
        [np.ravel(vertices).tolist(), np.ravel(faces).tolist(), points[name].ravel().tolist()]
        for name, (vertices, faces) in meshes.items()
    ]
    (folder / "meshes.json").write_text(json.dumps(given))
    told = run_module(
        folder,
        """
        import { readFileSync } from "node:fs";
        const engine = await load();
        const told = JSON.parse(readFileSync("meshes.json")).map(([vertices, faces, points]) => {
          const scene = engine.scene();
          scene.add("mesh", Float64Array.from(vertices), Int32Array.from(faces));
          const found = [scene.parts, scene.parts.map((part) => scene.signReason(part)),
            [...scene.signedDistance(points)], [...scene.closest(points).face]];
          scene.close();
          return found;
        });
        console.log(JSON.stringify(told));
        """,
    )
    for (names, reasons, distances, faces), (name, scene) in zip(told, python.items(), strict=True):
        assert names == [part.name for part in scene.parts], name
        assert reasons == [part.solid.sign_reason for part in scene.parts], name
        assert distances == scene.signed_distance(points[name]).tolist(), name
        assert faces == scene.closest(points[name]).face_id.tolist(), name


def test_meshes_come_and_go_and_are_refused_with_sentences(folder):
    told = run_module(
        folder,
        """
        const engine = await load(), scene = engine.scene(), told = [];
        const attempt = (act) => {
          try { told.push(act()); } catch (failure) { told.push(failure.message); }
        };
        const corners = new Float32Array([0, 0, 0, 1, 0, 0, 0, 1, 0]);
        const moved = [1, 0, 0, 5, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];
        attempt(() => scene.distance([0, 0, 1])[0]);
        attempt(() => scene.add("one", corners));
        attempt(() => scene.add("two", corners, [0, 1, 2], moved));
        attempt(() => scene.add("two", corners));
        attempt(() => scene.add("three", corners, [0, 1, 9]));
        attempt(() => scene.add("four", corners, undefined, [1, 2]));
        attempt(() => scene.castDistance([5.1, 0.1, 1], [0, 0, -1])[0]);
        attempt(() => { scene.remove("one"); return scene.parts.join(); });
        attempt(() => scene.remove("two"));
        console.log(JSON.stringify(told));
        """,
    )
    assert told[1:3] + told[6:8] == [0, 1, 1, "two"]
    sentences = (
        "the scene has no parts",
        "named 'two'",
        "refers to vertex 9",
        "2 numbers, expected 16",
        "the only part",
    )
    for number, sentence in zip((0, 3, 4, 5, 8), sentences, strict=True):
        assert sentence in told[number]


def test_clearance_is_that_of_python(folder):
    told = run_module(
        folder,
        """
const { readFileSync } = await import("node:fs");
const scene = (await load()).open(readFileSync("assembly.prox"));
const found = scene.parts.slice(1).map((part) => scene.clearance(scene.parts[0], part));
console.log(JSON.stringify(found.map((each) => [each.distance, each.lower, ...each.pointOnFirst,
  ...each.pointOnSecond, each.faceOnFirst, each.faceOnSecond])));
""",
    )
    scene = proximity.load(folder / "assembly.prox")
    first, *others = (part.name for part in scene.parts)
    for row, name in zip(told, others, strict=True):
        found = scene.clearance(first, name)
        ends = *found.point_on_first, *found.point_on_second
        assert row == [found.distance, found.lower, *ends, found.face_on_first, found.face_on_second]


def test_pairs_and_ticks_of_parts_are_those_of_python(folder):
    """Poses are shifted only, so that no sine or cosine of another library is in the answers."""
    told = run_module(
        folder,
        """
const { readFileSync } = await import("node:fs");
const scene = (await load()).open(readFileSync("assembly.prox")), told = [];
const plain = (_, value) => (typeof value === "bigint" ? Number(value)
  : ArrayBuffer.isView(value) ? [...value] : Number.isNaN(value) ? null : value === Infinity ? "inf" : value);
const [first, second] = scene.parts, direction = [0, 1, 2];
const limited = [{}, { most: 2 }, { of: second, maxDistance: 0.02 }];
told.push(...limited.map((limits) => scene.closestPairs(limits)));
told.push(scene.penetration(first, second), scene.penetration(first, second, { direction, tolerance: 0.1 }));
const tracker = scene.partTracker(scene.parts[1], { connections: 2, tolerance: 0.01 });
const matrix = [...scene.pose(1)];
for (let k = 0; k < 60; k++) {
  const now = 1_000_000_000_000n + 1_000_000n * BigInt(k);
  matrix[3] += 0.001;
  const given = k % 5 || k % 7 === 6 ? {} : { velocity: [1, 0, 0] };
  const found = tracker.tick(k % 7 === 6 ? undefined : matrix, now, now + 300n, given);
  told.push(found.map((each) => each.copy()));
}
tracker.close();
try { tracker.tick(matrix, 0n, 0n); } catch (error) { told.push(error.message); }
try { scene.partTracker("nothing"); } catch (error) { told.push(error.message); }
console.log(JSON.stringify(told, plain));
""",
    )
    scene = proximity.load(folder / "assembly.prox")
    names = [part.name for part in scene.parts]
    for found, limits in zip(told, ({}, {"most": 2}, {"of": names[1], "max_distance": 0.02}), strict=False):
        for pair, expected in zip(found, scene.closest_pairs(**limits), strict=True):
            assert (pair["first"], pair["second"]) == expected[:2]
            assert (pair["distance"], pair["lower"]) == (expected.distance, expected.lower)
            assert pair["pointOnFirst"] + pair["pointOnSecond"] == [
                *expected.point_on_first, *expected.point_on_second
            ]  # fmt: skip
    for found, options in zip(told[3:5], ({}, {"direction": [0, 1, 2], "tolerance": 0.1}), strict=True):
        expected = scene.penetration(*names[:2], **options)
        assert [found["depth"], found["lower"], *found["direction"]] == [*expected[2:4], *expected.direction]
        assert [found["deepest"], found["deepestLower"]] == [expected.deepest, expected.deepest_lower]
    tracker = proximity.PartTracker(scene, names[1], connections=2, tolerance=0.01)
    matrix = scene.parts[1].pose.matrix.copy()
    for k, found in enumerate(told[5:65]):
        matrix[0, 3] += 0.001
        now, given = 10**12 + 10**6 * k, {} if k % 5 or k % 7 == 6 else {"velocity": [1, 0, 0]}
        for record, row in zip(
            tracker.tick(None if k % 7 == 6 else matrix, now, now + 300, **given), found, strict=True
        ):
            for name in record.dtype.names:
                value = [None if np.isnan(each) else each for each in np.atleast_1d(record[name]).tolist()]
                each = row[name] if isinstance(row[name], list) else [row[name]]
                assert [np.inf if number == "inf" else number for number in each] == value, (k, name)
    assert told[65] == "the tracker is closed" and "nothing" in told[66]


def test_tracker_gives_the_contacts_of_python(folder):
    told = run_module(
        folder,
        """
const { readFileSync } = await import("node:fs");
const scene = (await load()).open(readFileSync("assembly.prox"));
const tracker = scene.tracker(2, { radius: 0.005, budget: 64 });
const contacts = [];
const plain = (_, value) => (typeof value === "bigint" ? Number(value)
  : typeof value === "number" && !Number.isFinite(value) ? String(value) : value);
for (let k = 0; k < 200; k++) {
  const now = 1_000_000_000n + BigInt(k) * 1_000_000n;
  const positions = [0.3 - 0.001 * k, 0.05, 0.05, NaN, 0, 0];
  const corners = [0, 0.5, 1].flatMap((x) => [0.3 - 0.001 * k - 0.3 * x, 0.05 - 0.04 * x, 0.05 - 0.05 * x]);
  corners.push(...new Array(9).fill(NaN));
  const known = { velocities: [-1, 0, 0, 0, 0, 0], corners, pathBends: [0, 0.3, 1], bends: [0.3, 0] };
  const found = tracker.tick(positions, k % 2 ? now : [now, now], now + 300n, k < 100 ? undefined : known);
  contacts.push(...(k < 150 ? found.map((each) => each.copy()) : JSON.parse(JSON.stringify(found, plain))));
}
tracker.close();
console.log(JSON.stringify(contacts, plain));
""",
    )
    scene = proximity.load(folder / "assembly.prox")
    tracker = proximity.Tracker(scene, fingers=2, radius=0.005, budget=64)
    expected = []
    for k in range(200):
        now = 1_000_000_000 + k * 1_000_000
        positions = np.array([[0.3 - 0.001 * k, 0.05, 0.05], [np.nan, 0, 0]])
        corners = np.full((2, 3, 3), np.nan)
        corners[0] = [[0.3 - 0.001 * k - 0.3 * x, 0.05 - 0.04 * x, 0.05 - 0.05 * x] for x in (0.0, 0.5, 1.0)]
        known = {"velocities": np.array([[-1.0, 0, 0], [0, 0, 0]]), "paths": corners}
        known |= {"path_bends": np.array([0.0, 0.3, 1.0]), "bends": np.array([0.3, 0.0])}
        expected += list(tracker.tick(positions, now, now + 300, **(known if k >= 100 else {})).copy())
    assert np.isfinite([row["contact_bend"] for row in expected]).any()

    for contact, row in zip(told, expected, strict=True):
        for name, value in contact.items():
            numbers = np.array(np.char.replace(np.array(value).astype(str), "Infinity", "inf"), np.float64)
            np.testing.assert_array_equal(numbers, np.float64(row[name]), name)


def test_errors_say_what_was_expected(folder):
    told = run_module(
        folder,
        """
const { readFileSync } = await import("node:fs");
const engine = await load();
const bytes = readFileSync("assembly.prox");
const scene = engine.open(bytes);
const damaged = Uint8Array.from(bytes);
damaged[20000] ^= 1;
const sentences = [];
let kept;
for (const action of [() => scene.signedDistance([1, 2]), () => scene.closest([0, 0, 0], { maxDistance: -1 }),
  () => scene.cast([0, 0, 0], [0, 0, 0]), () => scene.hide("no such part"), () => engine.open(damaged),
  () => engine.open(new Uint8Array(100)), () => scene.tracker(1, { speed: 1 }),
  () => scene.tracker(1).tick([0, 0, 0], [0n], 0n, { corners: [0, 0, 0] }),
  () => scene.tracker(1).tick([0, 0, 0], [0n], 0n, { velocities: [0, 0] }),
  () => scene.tracker(2).tick([0, 0, 0, 0, 0, 0], [0n], 0n), () => scene.tracker(1).tick([0, 0, 0], 0, 0n),
  () => { kept = scene.tracker(1); scene.close(); scene.distance([0, 0, 0]); },
  () => { engine.open(bytes); kept.tick([0, 0, 0], 0n, 0n); },
  () => { kept.close(); kept.tick([0, 0, 0], 0n, 0n); },
  () => {
    const tracker = engine.open(bytes).tracker(1), [contact] = tracker.tick([0, 0, 0], 0n, 0n);
    tracker.close();
    return contact.lower;
  },
  () => engine.open(new TextEncoder().encode(" <!DOCTYPE html>")),
  () => {
    const some = engine.open(bytes), out = some.closest([0, 0, 0]);
    some.closest([0, 0, 0, 1, 1, 1], { out });
  }]) {
  try {
    action();
    sentences.push("nothing");
  } catch (failure) {
    sentences.push(failure instanceof ProximityError ? failure.message : `other: ${failure}`);
  }
}
console.log(JSON.stringify(sentences));
""",
    )
    expected = (
        "three a row", "expected a length of 0 m or more", "direction 0 is zero", "no such part", "", "",
        "expected radius, latency", "expected three times two or more for each of 1", "expected 3",
        "there are 1 instants, expected 6 and 2", "expected BigInt, such as",
        "the scene is closed", "the scene is closed", "the tracker is closed",
        "the tracker of this answer is closed", "these bytes are HTML, expected a compiled scene",
        "out.signedDistance has 1 numbers, expected 2",
    )  # fmt: skip
    assert len(told) == len(expected)
    for sentence, words in zip(told, expected, strict=True):
        assert words in sentence and not sentence.startswith(("other", "nothing")), sentence


def test_example_and_programs_of_the_guide_print_distances(folder):
    printed = run(folder, "example.mjs", "assembly.prox")
    assert re.fullmatch(r"(-?[\d.]+ mm from .+, at \(.+\) m\n){2}", printed)

    page = PAGES["guide/browser-library.md"]
    programs = re.findall(r"```js\n(.*?)```.*?```text\n(.*?)```", page, re.DOTALL)
    proximity.load(MESHES / "bracket.stl", units="mm").save(folder / "bracket.prox")
    assert len(programs) == 3
    for code, printed in programs:
        (folder / "program.mjs").write_text(code.replace("./engine/", "./"))
        assert run(folder, "program.mjs") == printed


def test_without_the_plain_module_the_rest_is_written_with_a_note(tmp_path, monkeypatch, capsys):
    native = tmp_path / "native"
    native.mkdir()
    (native / "proximity.relaxed.wasm").write_bytes(
        (wasm_package.NATIVE / "proximity.relaxed.wasm").read_bytes()
    )
    monkeypatch.setattr(wasm_package, "NATIVE", native)

    sources.wasm(tmp_path / "site")

    said = capsys.readouterr().err
    assert "proximity.plain.wasm is not compiled" in said
    assert "build_kernels.py --target wasm32 --every-set" in said
    code = """
import { load } from "./proximity.mjs";
await load().then(() => console.log("loaded"), (failure) => console.log(failure.name, failure.message));
"""
    (tmp_path / "site" / "code.mjs").write_text(code)
    assert run(tmp_path / "site", "code.mjs") == "loaded\n"
    command = [NODE, "--no-experimental-wasm-relaxed-simd", "code.mjs"]
    old = subprocess.run(command, cwd=tmp_path / "site", capture_output=True, text=True, check=True)
    if "loaded" not in old.stdout:  # a Node that has the instructions regardless of the option
        assert re.match(r"ProximityError file:.*plain.wasm: there is no such file; it is for", old.stdout)


def test_module_imports_nothing_and_is_small(tmp_path):
    for name in wasm_package.MODULES:
        code = f"""
const {{ readFileSync }} = require("fs"), {{ gzipSync }} = require("zlib");
const bytes = readFileSync({json.dumps(os.fspath(wasm_package.NATIVE / name))});
const imports = WebAssembly.Module.imports(new WebAssembly.Module(bytes));
console.log(JSON.stringify([imports.length, gzipSync(bytes, {{ level: 9 }}).length]));
"""
        import_count, size = json.loads(run(tmp_path, "-e", code))
        assert import_count == 0 and size <= 650_000
