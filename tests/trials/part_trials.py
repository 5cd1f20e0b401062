"""Random trials of `PartTracker`: parts, settings and motions follow from one seed.

At some ticks, records are compared with `Scene.clearance` without a budget, and certified times with fine
steps of all parts along their velocities. `clearance` itself is verified by exact integer tests elsewhere.
"""

import warnings
from dataclasses import dataclass, field

import numpy as np
from project import MESHES, SHARED_DATA
from trial_cells import rotations_of, solid_of, solids_of_file, turned
from trial_log import Tally

from proximity import NO_PART, ConnectionFlag, PartTracker, Pose, Scene, Solid, UnitsWarning

warnings.simplefilter("ignore", UnitsWarning)  # parts are far apart

PAIRS = (
    ("busted.STL", "featuretype.STL"),
    ("featuretype.STL", "cycloidal.ply"),
    ("octagonal_pocket.stl", "busted.STL"),
    ("cycloidal.ply", "octagonal_pocket.stl"),
    ("bracket.stl", "gear.stl"),
    ("gear.stl", "plate.stl", "hollow_box.stl"),
    ("sphere.stl", "hollow_box.stl"),
    ("torus.ply", "bracket.stl"),
    ("assembly.glb", "torus.ply", "gear.stl"),
    ("cube", "hollow cube"),
    ("torus", "torus", "torus", "ball"),
    ("ball", "hollow ball", "shells"),
    ("slab", "voxels"),
    ("tetrahedron", "octahedron", "cube", "slab", "tetrahedron"),
    ("sheet", "open box", "cube"),
    ("band", "moebius", "torus"),
    ("crossed cubes", "voxels"),
    ("ball", "leaky ball", "holed ball"),
    ("cube", "cube", "cube"),
    ("fine ball", "sheet", "bracket.stl"),
)
"""Kinds or files: the tracked part, then the others."""
SIZES = (1e-4, 0.03, 0.1, 0.1, 0.1, 0.3, 20.0)  # m
BUDGETS = (None, None, None, 1, 3, 10, 40, 150, 1000)
STYLES = ("rest", "coast", "coast", "jitter", "jump", "approach", "approach", "together")
JUDGED = 10
"""Ticks between comparisons with the reference; its square, between those with fine steps."""
STEPS = 24
FLAGS = {name: np.uint32(flag) for name, flag in ConnectionFlag.__members__.items()}
SLIP = 2.0**-17 * (1.0 + 1e-6)
"""Displacement of touching parts before they separate, relative to the size."""
ROUNDING = 32.0 * 2.0**-52
"""Allowed distance error, relative to the largest coordinate."""


@dataclass(eq=False)
class PartLog:
    """Records of the judged ticks, a row per connection, and their reference values."""

    plan: str
    ticks: list = field(default_factory=list)
    records: list = field(default_factory=list)
    true: list = field(default_factory=list)  # m, to that part; without a part: to the nearest unreported one
    least: list = field(default_factory=list)  # m, to the nearest part
    rank: list = field(default_factory=list)  # m, sorted distances: to the nearest, the next, and so on
    relation: list = field(default_factory=list)  # to that part
    size: list = field(default_factory=list)  # m, largest coordinate
    off: list = field(default_factory=list)  # m, distance of the witness points from their surfaces

    def describe(self, row):
        """Format a row as text."""
        record = self.records[row]
        fields = ", ".join(f"{name} {record[name]!s}" for name in record.dtype.names)
        return f"tick {self.ticks[row]}: true {self.true[row]!r}, {self.relation[row]}; {fields}"


def solids_of(kind, size):
    """A part of a kind or file, scaled to *size*; voxels if the file is missing."""
    for path in (MESHES / kind, SHARED_DATA / "cad" / kind):
        if path.is_file():
            return solids_of_file(path, size)[0]
    return solid_of("voxels" if "." in kind else kind, size)


class PartCell:
    """Moving parts, and a second scene of the same parts for predicted poses."""

    def __init__(self, rng, kinds, size):
        self.rng, self.size, self.count = rng, size, len(kinds)
        solids = [solids_of(kind, size * rng.choice([0.1, 0.3, 1.0, 1.0])) for kind in kinds]
        self.solids = solids
        self.names = [f"part {number}" for number in range(self.count)]
        self.held = int(rng.integers(self.count)) if rng.random() < 0.5 else 0
        self.middles = np.array([np.mean(solid.bounds, axis=0) for solid in solids])
        self.quaternions = rng.normal(size=(self.count, 4))
        self.quaternions /= np.linalg.norm(self.quaternions, axis=1, keepdims=True)
        self.translations = rng.uniform(-1.0, 1.0, (self.count, 3)) * size * rng.choice([0.4, 1.0])
        self.translations += rng.choice([0.0, 0.0, 0.0, 1000.0]) * size
        self.homes = self.translations.copy()
        self.velocities, self.spins = np.zeros((2, self.count, 3))
        self.hidden: set[int] = set()
        meshes = zip(self.names, [solid.mesh for solid in solids], strict=True)
        parts = [Solid(mesh.vertices, mesh.faces, name=name) for name, mesh in meshes]
        self.scene, self.twin = Scene(parts), Scene(parts)
        for number in range(self.count):
            self.place(self.scene, number)

    def place(self, scene, number, seconds=0.0):
        """Set a part of a scene to its pose *seconds* later."""
        scene.move(
            self.names[number],
            Pose(
                rotations_of(turned(self.quaternions[number], seconds * self.spins[number])),
                self.translations[number] + seconds * self.velocities[number],
            ),
            velocity=self.velocities[number],
            angular_velocity=self.spins[number],
        )

    def pose(self):
        """The pose of the tracked part."""
        return Pose(rotations_of(self.quaternions[self.held]), self.translations[self.held])

    def true_ahead(self, seconds):
        """Smallest distance of the tracked part after *seconds* at the current velocities."""
        for number in range(self.count):
            self.place(self.twin, number, seconds)
        held = self.names[self.held]
        distances = [self.twin.clearance(held, self.names[row]).distance for row in self.others()]
        return min(distances, default=np.inf)

    def diagonal(self):
        """Box diagonal of the tracked part, m."""
        lower, upper = self.solids[self.held].bounds
        return float(np.linalg.norm(upper - lower))

    def others(self):
        """Rows of the other visible parts."""
        return [row for row in range(self.count) if row != self.held and row not in self.hidden]

    def toggle(self, number):
        """Toggle the visibility of a part."""
        self.hidden ^= {number}
        (self.scene.hide if number in self.hidden else self.scene.show)(self.names[number])

    def step(self, style, numbers, record, period):
        """Move some parts by one tick."""
        rng, held, shape = self.rng, self.held, (len(numbers), 3)
        if style == "jump":
            self.translations[numbers] = self.homes[numbers] + rng.normal(size=shape) * 0.3 * self.size
            if rng.random() < 0.5:
                self.enter(int(rng.integers(self.count)))
        if style == "jitter":
            reach = self.size * 10.0 ** rng.uniform(-9.0, -2.0)
            self.translations[numbers] += rng.normal(size=shape) * reach
            spins = rng.normal(size=shape) * 10.0 ** rng.uniform(-9.0, -2.0)
            self.quaternions[numbers] = turned(self.quaternions[numbers], spins)
        if style in ("coast", "together"):
            self.translations[numbers] += period * self.velocities[numbers]
            self.quaternions[numbers] = turned(self.quaternions[numbers], period * self.spins[numbers])
        if style == "approach" and np.isfinite(record["distance"]):
            share = rng.choice([0.1, 0.5, 0.9, 0.999, 1.0, 1.0, 1.001])
            aside = rng.normal(size=3) * self.size * rng.choice([0.0, 1e-12, 1e-6, 1e-3])
            self.translations[held] += aside - share * record["distance"] * record["normal"]

    def enter(self, number):
        """Move the centre of the tracked part into another part, at a random position."""
        lower, upper = self.solids[number].bounds
        place = self.middles[number] + self.rng.uniform(-0.3, 0.3, 3) * (upper - lower)
        place = rotations_of(self.quaternions[number]) @ place + self.translations[number]
        middle = rotations_of(self.quaternions[self.held]) @ self.middles[self.held]
        self.translations[self.held] = place - middle

    def begin(self, style):
        """Choose the moving parts and their velocities."""
        rng = self.rng
        are_all = style == "together" or rng.random() < 0.2
        numbers = np.arange(self.count) if are_all else np.array([self.held])
        self.velocities[:], self.spins[:] = 0.0, 0.0
        if style in ("coast", "together"):
            count = 1 if style == "together" else len(numbers)
            home = self.homes[numbers[:count]] - self.translations[numbers[:count]]
            speeds = self.size * 10.0 ** rng.uniform(-3.0, 1.0, (count, 1))
            self.velocities[numbers] = rng.normal(size=(count, 3)) * speeds + home
            turning = 0.0 if style == "together" or rng.random() < 0.4 else 10.0 ** rng.uniform(-2.0, 1.3)
            self.spins[numbers] = rng.normal(size=(len(numbers), 3)) * turning
        if style == "jump" and rng.random() < 0.5:
            self.quaternions[self.held] = turned(self.quaternions[self.held], rng.normal(size=3))
        return numbers


def run_trial(seed, ticks):
    """Run a trial of *ticks* ticks; return its plan and the tally of its checks."""
    rng = np.random.default_rng([seed, ticks])
    kinds = PAIRS[(seed + seed // len(PAIRS)) % len(PAIRS)]  # combines each pair with every trial size
    cell = PartCell(rng, kinds, float(rng.choice(SIZES)))
    settings = {
        "connections": int(rng.integers(1, 4)),
        "working_range": float(cell.size * rng.choice([0.02, 0.3, np.inf, np.inf])),
        "tolerance": float(rng.choice([0.0, 0.0, 0.0, 0.05, 0.5])),
        "budget": BUDGETS[rng.integers(len(BUDGETS))],
        "latency": float(rng.choice([0.0, 0.001, 0.02])),
        "horizon": float(rng.choice([0.02, 0.25, 2.0])),
    }
    tracker, log, tally = PartTracker(cell.scene, cell.names[cell.held], **settings), [], Tally()
    log = PartLog(f"trial {seed}: {kinds}, size {cell.size:g}, part {cell.held}, {settings}")
    now, record, left, period = 10**12, tracker.connections[0], 0, float(rng.choice([1e-3, 1e-3, 1e-2]))
    for tick in range(ticks):
        is_going = left > 0
        if not is_going:
            left, style = int(rng.integers(20, 300)), str(rng.choice(STYLES))
            numbers = cell.begin(style)
            if style == "jump":
                left = 5
            if rng.random() < 0.1:
                cell.toggle(int(rng.integers(cell.count)))
            if rng.random() < 0.1:
                tracker.reset()
        left -= 1
        cell.step(style, numbers, record, period)
        for number in numbers if is_going else range(cell.count):
            if number != cell.held:
                cell.place(cell.scene, number)
        now += int(1e9 * period)
        given = {"velocity": cell.velocities[cell.held], "angular_velocity": cell.spins[cell.held]}
        is_moved = rng.random() < 0.5  # before the tick, in the scene
        if is_moved:
            cell.scene.move(cell.names[cell.held], cell.pose(), **given)
        record = tracker.tick(None if is_moved else cell.pose(), now, now, **({} if is_moved else given))[0]
        if tick % JUDGED == 0 or tick < 2:
            _note(log, cell, tick, tracker.connections)
        if tick % JUDGED**2 == 0:
            _judge_times(log, tally, cell, tick, record.copy(), tracker.free_time, _speed(tracker))
    _judge(log, tally, settings)
    tally.broken = [f"{log.plan}\n    {broken}" for broken in tally.broken]
    return log.plan, tally


def _note(log, cell, tick, records):
    """Append records and their reference values to the log."""
    names, held = cell.names, cell.names[cell.held]
    found = {row: cell.scene.clearance(held, names[row]) for row in cell.others()}
    distances = {row: pair.distance for row, pair in found.items()}
    rank, known = sorted(distances.values()) + [np.inf] * len(records), set(records["part"].tolist())
    rest = [distance for row, distance in distances.items() if row not in known]
    for place, record in enumerate(records.copy()):
        is_known, row = record["part"] != NO_PART, int(record["part"])
        log.ticks.append(tick)
        log.records.append(record)
        log.true.append(distances[row] if is_known else min(rest, default=np.inf))
        log.least.append(rank[0] if place == 0 else -1.0)
        log.rank.append(rank[place])
        log.relation.append(str(found[row].relation) if is_known else "")
        log.size.append(np.abs(cell.translations).max() + cell.size)
        ends = [(cell.held, record["point_on_own"]), (row, record["point_on_part"])] if is_known else []
        if is_known and record["flags"] & ConnectionFlag.INSIDE:  # both are on the surface of one of them
            ends = [min(ends, key=lambda end: _off(cell, *end))]
        log.off.append(max((_off(cell, part, point) for part, point in ends), default=0.0))


def _off(cell, number, point):
    """Distance of a point from the surface of a part, m."""
    pose = Pose(rotations_of(cell.quaternions[number]), cell.translations[number])
    return float(cell.solids[number].distance(pose.inverse.point(point)))


def _judge(log, tally, settings):
    """Compare all records with their reference values."""
    records = np.array(log.records)
    true, least, rank, size, off = (
        np.array(each) for each in (log.true, log.least, log.rank, log.size, log.off)
    )
    flags, relation = records["flags"], np.array(log.relation)
    has = {name: (flags & bit) == bit for name, bit in FLAGS.items()}
    is_known = records["part"] != NO_PART
    is_first = least >= 0.0
    room = ROUNDING * size
    lower, upper = records["lower"], records["upper"]

    def look(name, excess, rows):
        tally.look(name, log, excess[rows], room[rows], rows)

    def demand(name, is_so, rows):
        tally.demand(name, log, is_so[rows], rows)

    with np.errstate(invalid="ignore"):  # inf - inf
        look("lower <= true", lower - true, (is_known | ~is_first) & np.isfinite(true))
        look("the first lower bound holds for all", lower - least, is_first & np.isfinite(least))
        look("true <= upper", true - upper, is_known)
        look("exact is exact", np.abs(upper - true), is_known & has["EXACT"] & has["IN_RANGE"])
        apart = np.linalg.norm(records["point_on_own"] - records["point_on_part"], axis=1)
        is_plain = is_known & ~has["INSIDE"] & ~has["CROSSING"]
        look("ends are as far apart as told", np.abs(apart - upper), is_plain)
        look("ends are on their surfaces", off, is_known)
        demand("bounds are in order", (lower <= upper) & (lower >= 0.0), is_known)
        crosses, inside = relation == "crossing", np.char.find(relation, "inside") >= 0
        demand("CROSSING is true", crosses, is_known & has["CROSSING"])
        demand("INSIDE is true", inside | (relation == "touching"), is_known & has["INSIDE"])
        if settings["budget"] is None:
            in_range = is_known & has["IN_RANGE"]
            demand("what crosses is told", has["CROSSING"], in_range & crosses)
            demand("what is inside is told", has["INSIDE"], in_range & inside)
            reach = (1.0 + settings["tolerance"]) * (1.0 + 1e-9)
            within = np.isfinite(rank) & (rank <= settings["working_range"])
            look("the nearest are answered", upper - rank * reach, is_known & within)
            demand("all in range are answered", is_known, within)


def _speed(tracker):
    """The smallest positive speed of the tracker's pairs, m/s."""
    speeds = tracker._arrays.pairs["speed"]
    return float(speeds[speeds > 0.0].min(initial=np.inf))


def _judge_times(log, tally, cell, tick, record, free_time, speed):
    """Compare times and predictions with parts moved ahead."""
    end, row = (1.0 - 1e-9) * free_time, log.ticks.index(tick)
    rows = np.array([row])
    if free_time > 0.0:
        begin = 0.0
        if log.least[row] <= ROUNDING * log.size[row]:  # contact may last for the slip
            begin = min(SLIP * cell.diagonal() / speed, end)
        met = [t for t in np.linspace(begin, end, STEPS) if cell.true_ahead(t) <= 0.0]
        tally.demand("nothing is met before the certified time", log, np.array([not met]), rows)
    room = ROUNDING * log.size[row] * 4.0
    ahead = 1e-9 * float(record["predicted_ns"] - record["pose_ns"])
    if record["part"] != NO_PART and ahead > 0.0:
        true = cell.true_ahead(ahead)
        tally.look("predicted lower <= true", log, np.array([record["predicted_lower"] - true]), room, rows)
    tally.demand(
        "the certified time is no later than the expected",
        log,
        np.array([not record["time_to_contact"] < record["time_to_contact_lower"] * (1.0 - 1e-6)]),
        rows,
    )
