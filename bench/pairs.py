"""Distances of pairs of parts against other libraries: ``python bench/pairs.py [PAIR ...]``.

Rivals are those of Coal, python-fcl and MeshLib that are installed (group ``bench``). Each pair moves along a
path; at every pose all answers are compared before any time counts. Thread CPU time from Python, on one core,
µs, median and 99th percentile. MeshLib computes in float32.

*In a loop*: each library answers ten poses in turn, with warm caches. *After other work*: 64 MB of other
memory are read before each answer, as by a program that draws a picture in between.

``python bench/pairs.py assembly``: 200 parts, a million faces. All pairs within 5 mm against the broad phase
of python-fcl; and a part that is tracked among the others. ``--files ONE OTHER``: the first parts of two
files, each made 0.1 m large, 2 mm apart. ``--json bench/published/pairs.json`` stores the figures.
"""

import argparse
from collections.abc import Callable, Iterator
from importlib import import_module, util
from itertools import product
from pathlib import Path
from time import thread_time_ns

from benchmarks.support import threads

# Before NumPy and the rivals are imported.
THREADS = threads.limit_to_one_thread() if __name__ == "__main__" else threads.UNLIMITED

import numpy as np

from benchmarks.support.machine import describe_machine
from benchmarks.support.output import write_json
from proximity import PartTracker, Pose, Scene, Solid, load

Mesh = tuple[np.ndarray, np.ndarray]
Asker = Callable[[Pose], Callable[[], float]]
POSES, MOVED_POSES, IN_TURN = 120, 1000, 10
OTHER_MEMORY = np.ones(8_000_000)
LOOP, AFTER_WORK = "in a loop", "after other work"
MESHES = Path(__file__).resolve().parents[1] / "meshes"
AGREEMENT = 2e-6
"""m by which answers may differ: parts are 0.1 m large, and one rival computes in float32."""


def lathe(profile: list[tuple[float, float]], steps: int, turns: int) -> Mesh:
    """Return a solid of revolution: each side of the profile (radius, height) in *steps*, *turns* around."""
    corners = np.array(profile)
    shares = np.linspace(0.0, 1.0, steps, endpoint=False)[:, None]
    line = np.concatenate(
        [a + (b - a) * shares for a, b in zip(corners, np.roll(corners, -1, 0), strict=True)]
    )
    angles = np.linspace(0.0, 2.0 * np.pi, turns, endpoint=False)[:, None]
    vertices = np.stack(
        [np.cos(angles) * line[:, 0], np.sin(angles) * line[:, 0], np.ones_like(angles) * line[:, 1]], axis=-1
    ).reshape(-1, 3)
    rows, columns = np.divmod(np.arange(len(vertices)), len(line))
    after, above = (rows + 1) % turns * len(line), (columns + 1) % len(line)
    a, b, c, d = rows * len(line) + columns, rows * len(line) + above, after + above, after + columns
    return vertices, np.concatenate([np.stack([a, d, c], 1), np.stack([a, c, b], 1)]).astype(np.int32)


def free_form(turns: int, seed: int) -> Mesh:
    """Return a bent ring, 0.1 m large, of 4 *turns*² faces."""
    circle = np.linspace(0.0, 2.0 * np.pi, 2 * turns, endpoint=False)
    profile = [(0.03 + 0.0125 * np.cos(angle), 0.0125 * np.sin(angle)) for angle in circle]
    vertices, faces = lathe(profile, 1, turns)
    rng = np.random.default_rng(seed)
    for _ in range(6):
        waves = 120.0 * rng.normal(size=3)
        vertices = vertices + 0.001 * np.sin(vertices @ waves + rng.uniform(0.0, 6.0))[:, None] * rng.normal(
            size=3
        )
    return vertices, faces


def beside(scene: Scene, gap: float) -> Pose:
    """Return the pose of the moving part at a *gap* from the other."""
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    near, far = 0.0, 0.3
    for _ in range(40):
        middle = 0.5 * (near + far)
        scene.move("b", Pose(turn, [middle, 0.3 * middle, 0.0]))
        near, far = (near, middle) if scene.clearance("a", "b").distance > gap else (middle, far)
    return Pose(turn, [far, 0.3 * far, 0.0])


def path(start: Pose, radius: float, count: int, step: float) -> Iterator[Pose]:
    """Return poses on a circle through *start*, turning a little, *step* m from one to the next."""
    for k in range(count):
        angle = k * step / radius
        turn = 25.0 * radius * np.sin(angle)
        about = np.array(
            [[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]]
        )
        move = radius * np.array([0.0, np.sin(angle), 1.0 - np.cos(angle)])
        yield Pose(about @ start.rotation, start.translation + move)


def free_pair(one: int, other: int, gap: float) -> Callable[[], tuple[Mesh, Mesh, Pose]]:
    """Return a pair of free forms with *one* and *other* turns."""

    def make() -> tuple[Mesh, Mesh, Pose]:
        meshes = free_form(one, 1), free_form(other, 2)
        scene = Scene([Solid(*mesh, name=name) for name, mesh in zip("ab", meshes, strict=True)])
        return *meshes, beside(scene, gap)

    return make


def peg() -> tuple[Mesh, Mesh, Pose]:
    """Return a peg of 16 thousand faces in a hole of 33 thousand, with a clearance of 1 % of its radius."""
    hole = lathe([(0.010, -0.02), (0.02, -0.02), (0.02, 0.02), (0.010, 0.02)], 32, 128)
    pin = lathe([(0.0005, -0.015), (0.0099, -0.015), (0.0099, 0.025), (0.0005, 0.025)], 16, 128)
    return hole, pin, Pose(None, [3e-5, 0.0, 0.0])


def screw() -> tuple[Mesh, Mesh, Pose]:
    """Return a screw of 12 thousand faces through a plate of 32 thousand, its head 0.1 mm above it."""
    plate = lathe([(0.0033, 0.0), (0.04, 0.0), (0.04, 0.01), (0.0033, 0.01)], 32, 128)
    turns = [(0.003 - 0.0004 * (k % 2), 0.015 - 0.0005 * k) for k in range(40)]
    profile = [(0.0002, -0.006), (0.003, -0.006), *reversed(turns), (0.003, 0.0151), (0.006, 0.0151)]
    return plate, lathe([*profile, (0.006, 0.019), (0.0002, 0.019)], 1, 128), Pose(None, [1e-4, 0.0, -0.005])


def gears() -> tuple[Mesh, Mesh, Pose]:
    """Return two gears in mesh, turned by half a tooth, with backlash."""
    mesh = load(MESHES / "gear.stl").parts[0].solid.mesh
    gear = np.array(mesh.vertices), mesh.faces.astype(np.int32)
    return gear, gear, Pose(turn_about_z(np.pi / 24.0), [0.0485, 0.0, 0.0])


def files_pair(one: Path, other: Path, gap: float) -> Callable[[], tuple[Mesh, Mesh, Pose]]:
    """Return the first parts of two files, each 0.1 m large, at a gap."""

    def sized(path: Path) -> Mesh:
        mesh = load(path).parts[0].solid.mesh
        size = np.ptp(mesh.vertices, axis=0)
        middle = mesh.vertices.min(axis=0) + 0.5 * size
        return 0.1 / size.max() * (mesh.vertices - middle), mesh.faces.astype(np.int32)

    def make() -> tuple[Mesh, Mesh, Pose]:
        meshes = sized(one), sized(other)
        scene = Scene([Solid(*mesh, name=name) for name, mesh in zip("ab", meshes, strict=True)])
        return *meshes, beside(scene, gap)

    return make


PAIRS = {
    "bracket and gear": files_pair(MESHES / "bracket.stl", MESHES / "gear.stl", 0.002),
    "two gears": gears,
    "screw in plate": screw,
    "3.5 x 3.5 k, gap 2 %": free_pair(30, 30, 0.002),
    "3.5 x 84 k, gap 2 %": free_pair(30, 145, 0.002),
    "84 x 84 k, gap 2 %": free_pair(145, 145, 0.002),
    "84 x 84 k, gap 20 %": free_pair(145, 145, 0.02),
    "peg in hole": peg,
}
RADII = {"two gears": 5e-5, "screw in plate": 5e-5, "peg in hole": 1e-5}
"""m, of the paths of parts that have little room."""


def coal_asker(one: Mesh, other: Mesh) -> Asker:
    """Coal with its OBBRSS trees."""
    coal = import_module("coal")

    def tree(mesh: Mesh):
        model, points, triangles = coal.BVHModelOBBRSS(), coal.StdVec_Vec3s(), coal.StdVec_Triangle()
        for point in mesh[0]:
            points.append(point)
        for face in mesh[1].tolist():
            triangles.append(coal.Triangle(*face))
        model.beginModel(len(mesh[1]), len(mesh[0]))
        model.addSubModel(points, triangles)
        model.endModel()
        return model

    models, stands = (tree(one), tree(other)), coal.Transform3s()

    def at(pose: Pose):
        there = coal.Transform3s(np.ascontiguousarray(pose.rotation), np.ascontiguousarray(pose.translation))
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        return lambda: coal.distance(models[0], stands, models[1], there, request, result)

    return at


def fcl_asker(one: Mesh, other: Mesh) -> Asker:
    """python-fcl with its OBBRSS trees."""
    fcl = import_module("fcl")

    def item(mesh: Mesh):
        model = fcl.BVHModel()
        model.beginModel(len(mesh[0]), len(mesh[1]))
        model.addSubModel(*mesh)
        model.endModel()
        return fcl.CollisionObject(model, fcl.Transform())

    items = item(one), item(other)

    def at(pose: Pose):
        items[1].setTransform(fcl.Transform(np.array(pose.rotation), np.array(pose.translation)))
        return lambda: fcl.distance(*items)

    return at


def meshlib_asker(one: Mesh, other: Mesh) -> Asker:
    """MeshLib, in float32."""
    library, arrays = import_module("meshlib.mrmeshpy"), import_module("meshlib.mrmeshnumpy")
    meshes = [arrays.meshFromFacesVerts(mesh[1], mesh[0].astype(np.float32)) for mesh in (one, other)]
    parts = [library.MeshPart(mesh) for mesh in meshes]

    def at(pose: Pose):
        rows = [library.Vector3f(*row) for row in pose.rotation.tolist()]
        there = library.AffineXf3f(library.Matrix3f(*rows), library.Vector3f(*pose.translation.tolist()))
        return lambda: np.sqrt(library.findDistance(*parts, there).distSq)

    return at


RIVALS = {"coal": coal_asker, "fcl": fcl_asker, "meshlib": meshlib_asker}


def timed(ask: Callable[[], float]) -> tuple[float, float]:
    """Return an answer, and its duration, µs."""
    start = thread_time_ns()
    answer = ask()
    return 1e-3 * (thread_time_ns() - start), float(answer)


def shown(times: list[float]) -> str:
    """Return median and 99th percentile."""
    return "{:9.1f} ({:.1f})".format(*np.percentile(times, [50, 99]))


def own_asker(one: Mesh, other: Mesh) -> Asker:
    """This engine."""
    scene = Scene([Solid(*one, name="a"), Solid(*other, name="b")])

    def at(pose: Pose):
        scene.move("b", pose)
        return lambda: scene.clearance("a", "b").distance

    return at


def compare(one: Mesh, other: Mesh, start: Pose, radius: float) -> dict[str, dict[str, list[float]]]:
    """Print the times of all, without history; return medians and 99th percentiles."""
    askers = {"proximity": own_asker(one, other)}
    askers |= {name: make(one, other) for name, make in RIVALS.items() if util.find_spec(name)}
    poses = list(path(start, radius, POSES, 3.0 * radius / POSES))
    for pose in poses:
        distance, *answers = (float(asker(pose)()) for asker in askers.values())
        for name, answer in zip(list(askers)[1:], answers, strict=True):
            if abs(answer - distance) > AGREEMENT:
                raise SystemExit(f"{name} answers {answer} m, proximity {distance} m")
    found: dict[str, dict[str, list[float]]] = {}
    for manner in (LOOP, AFTER_WORK):
        times: dict[str, list[float]] = {name: [] for name in askers}
        for begin, (name, asker) in product(range(0, POSES, IN_TURN), askers.items()):
            asker(poses[begin])()
            for pose in poses[begin : begin + IN_TURN]:
                ask = asker(pose)
                if manner == AFTER_WORK:
                    OTHER_MEMORY.sum()
                times[name].append(timed(ask)[0])
        for name, each in times.items():
            print(f"    {name:12}{manner:20} {shown(each)}", flush=True)
        found[manner] = {name: np.percentile(each, [50, 99]).tolist() for name, each in times.items()}
    return found


def follow(one: Mesh, other: Mesh, start: Pose, radius: float) -> dict[str, list[float]]:
    """Print the times of a tracker; return medians and 99th percentiles of exact answers."""
    found = {}
    for options in ({}, {"tolerance": 0.05}, {"budget": 300}):
        for speed in (0.02, 0.2):
            scene = Scene([Solid(*one, name="a"), Solid(*other, name="b")])
            tracker, times, gaps = PartTracker(scene, "b", **options), [], []
            for tick, pose in enumerate(path(start, radius, MOVED_POSES, speed * 1e-3)):
                scene.move("b", pose)
                now = 10**12 + tick * 10**6
                start_ns = thread_time_ns()
                record = tracker.tick(None, now, now)[0]
                times.append(1e-3 * (thread_time_ns() - start_ns))
                gaps.append(1.0 - record["lower"] / record["upper"] if record["upper"] > 0.0 else 0.0)
            report_followed(options, speed, times, gaps)
            if not options:
                name = "followed at 20 mm/s" if speed < 0.1 else "at 200 mm/s"
                found[name] = np.percentile(times, [50, 99]).tolist()
    return found


def report_followed(options: dict[str, float], speed: float, times: list[float], gaps: list[float]) -> None:
    """Print the times of a tracker, and the shares by which its bounds differ."""
    text = ", ".join(f"{name} {value:g}" for name, value in options.items()) or "exact"
    way = f"followed, {1e3 * speed:3.0f} mm/s, {text}"
    median, most = np.percentile(gaps, [50, 99])
    print(f"    {way:48} {shown(times)}  bounds {median:.1%} ({most:.1%}) apart", flush=True)


WITHIN = 0.005  # m
ROUNDS = 3
COLUMNS, PITCH, AISLE = 5, 0.06, 0.05
"""Columns to each side, their pitch, m, and the additional width of the aisle in which a part moves."""
FOLLOWED = ({}, {"tolerance": 0.05}, *({"tolerance": 0.05, "budget": steps} for steps in (100, 300, 600)))


def column(rng: np.random.Generator, x: float, y: float) -> Iterator[tuple[Mesh, Pose]]:
    """Return a shaft, six discs with 1 mm of clearance, and a bent ring: about 5 thousand faces each."""
    yield lathe([(0.001, 0.0), (0.008, 0.0), (0.008, 0.1), (0.001, 0.1)], 8, 80), Pose(None, [x, y, 0.0])
    height = 0.002
    for _ in range(6):
        outer, thick = rng.uniform(0.026, 0.0295), rng.uniform(0.005, 0.009)
        dx, dy = rng.uniform(-3e-4, 3e-4, 2)
        disc = lathe([(0.009, 0.0), (outer, 0.0), (outer, thick), (0.009, thick)], 8, 80)
        yield disc, Pose(turn_about_z(rng.uniform(0.0, 6.0)), [x + dx, y + dy, height])
        height += thick + rng.uniform(0.0003, 0.006)
    vertices, faces = free_form(36, int(rng.integers(1000)))
    ring = 0.55 * vertices, faces
    yield ring, Pose(turn_about_z(rng.uniform(0.0, 6.0)), [x, y, height + 0.011])


def turn_about_z(angle: float) -> np.ndarray:
    """Return a rotation."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def assembly() -> list[tuple[Mesh, Pose]]:
    """Return 200 parts of a million faces in total, as close to each other as in a machine, with an aisle."""
    rng, parts = np.random.default_rng(47), []
    for i, j in product(range(COLUMNS), repeat=2):
        parts += column(rng, PITCH * i + (AISLE if i > 1 else 0.0), PITCH * j)
    return parts


def fcl_pairs(parts: list[tuple[Mesh, Pose]]) -> Callable[[], dict[frozenset, float]]:
    """Return pairs of parts within 5 mm, and their distances, by python-fcl's tree of boxes.

    Parts are rotated beforehand: boxes of its objects are tight only for unrotated ones.
    """
    fcl, rows, manager = import_module("fcl"), {}, import_module("fcl").DynamicAABBTreeCollisionManager()
    for row, ((vertices, faces), pose) in enumerate(parts):
        model, there = fcl.BVHModel(), vertices @ pose.rotation.T
        model.beginModel(len(vertices), len(faces))
        model.addSubModel(there, faces)
        model.endModel()
        rows[tuple(pose.translation)] = row
        manager.registerObject(fcl.CollisionObject(model, fcl.Transform(pose.translation)))
    manager.setup()

    def within(one, other, found):
        distance = fcl.distance(one, other)
        if distance <= WITHIN:
            found[frozenset((rows[tuple(one.getTranslation())], rows[tuple(other.getTranslation())]))] = (
                distance
            )
        return False, WITHIN

    def ask() -> dict[frozenset, float]:
        found: dict[frozenset, float] = {}
        manager.distance(found, within)
        return found

    return ask


def compare_assembly(scene: Scene, parts: list[tuple[Mesh, Pose]]) -> None:
    """Print the times for all pairs within 5 mm."""
    asker = fcl_pairs(parts) if util.find_spec("fcl") else None
    times: dict[str, list[float]] = {"proximity": []} | ({"fcl": []} if asker else {})
    for _ in range(ROUNDS):
        start = thread_time_ns()
        pairs = scene.closest_pairs(max_distance=WITHIN)
        times["proximity"].append(1e-6 * (thread_time_ns() - start))
        if asker:
            start = thread_time_ns()
            answer = asker()
            times["fcl"].append(1e-6 * (thread_time_ns() - start))
            ours = {frozenset((int(pair.first), int(pair.second))): pair.distance for pair in pairs}
            if ours.keys() != answer.keys() or any(abs(ours[key] - answer[key]) > AGREEMENT for key in ours):
                raise SystemExit("fcl answers other pairs, or other distances")
    meeting = sum(not pair.distance for pair in pairs)
    print(f"    {len(pairs)} pairs within {1e3 * WITHIN:g} mm, {meeting} of them meet")
    for name, each in times.items():
        print(f"    {name:24} {np.median(each):9.1f} ms")


def follow_in_assembly(scene: Scene) -> None:
    """Print the times of a tracker of a part of 20 thousand faces in the aisle."""
    mesh, start = free_form(70, 5), [1.5 * PITCH + 0.5 * AISLE, 2.0 * PITCH, 0.03]
    scene.add(Solid(0.9 * mesh[0][:, [2, 0, 1]], mesh[1], name="held"))
    for options, speed in product(FOLLOWED, (0.02, 0.2)):
        tracker, times, gaps = PartTracker(scene, "held", **options), [], []
        for tick, pose in enumerate(path(Pose(None, start), 5e-3, MOVED_POSES, speed * 1e-3)):
            now = 10**12 + tick * 10**6
            time, _ = timed(lambda: tracker.tick(pose, now, now)[0]["upper"])  # noqa: B023
            record = tracker.connections[0]
            times.append(time)
            gaps.append(1.0 - record["lower"] / record["upper"] if record["upper"] > 0.0 else 0.0)
            if tick % 50 == 0:
                true = scene.closest_pairs(of="held", most=1)[0].distance
                if not record["lower"] <= true * (1.0 + 1e-12) <= record["upper"] * (1.0 + 2e-12):
                    raise SystemExit(f"bounds {record['lower']} and {record['upper']} m, distance {true} m")
        report_followed(options, speed, times, gaps)
    size = sum(array.nbytes for array in tracker._arrays)
    print(f"    memory of a tracker: {1e-3 * size:.0f} kB")


def measure_assembly() -> None:
    """Measure the assembly."""
    parts = assembly()
    scene = Scene([Solid(*mesh, name=str(row)) for row, (mesh, _) in enumerate(parts)])
    scene.move_many([str(row) for row in range(len(parts))], [pose for _, pose in parts])
    print(f"assembly: {len(parts)} parts, {sum(len(mesh[1]) for mesh, _ in parts)} faces", flush=True)
    compare_assembly(scene, parts)
    follow_in_assembly(scene)


def main(words: list[str] | None = None) -> None:
    """Compare the named pairs, or all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "pairs", nargs="*", choices=[[], *PAIRS, "assembly"], help="names of pairs; default: all"
    )
    parser.add_argument(
        "--files", nargs=2, type=Path, action="append", default=[], help="the parts of two files, too"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="store medians and 99th percentiles")
    options = parser.parse_args(words)
    files = {f"{one.stem} and {other.stem}": files_pair(one, other, 0.002) for one, other in options.files}
    PAIRS.update(files)
    rows = []
    for name in [*options.pairs, *files] or [*PAIRS, "assembly"]:
        if name == "assembly":
            measure_assembly()
            continue
        one, other, start = PAIRS[name]()
        radius = RADII.get(name, 2e-3)
        print(f"{name}: {len(one[1])} x {len(other[1])} faces; µs, median (p99)", flush=True)
        compared = compare(one, other, start, radius)
        followed = follow(one, other, start, radius)
        rows.append({"pair": name, "times": compared[LOOP] | followed, "cold": compared[AFTER_WORK]})
    if options.json:
        write_json(options.json, describe_machine(THREADS), rows=rows)


if __name__ == "__main__":
    main()
