"""Sections of the comparison with other libraries: each returns its rows and prints them."""

import itertools
import tempfile

from benchmarks.queries import cases
from benchmarks.queries.agreement import ask, check_all
from benchmarks.queries.command_line import command_runs
from benchmarks.queries.results import (
    BUILD,
    FIVE_RAYS,
    FIVE_SIGNED,
    OUR_TREE,
    OURS,
    POINTS,
    PROCESS,
    RAYS,
    SIGNED,
    Row,
    make_row,
)
from benchmarks.queries.tables import print_rows
from benchmarks.rivals.ours import Proximity
from benchmarks.support.interleaving import interleave
from benchmarks.support.project import TEMPORARY_PREFIX

BUILD_ROUNDS, PROCESS_ROUNDS = 5, 5
NS_PER_US, NS_PER_MS, NS_PER_S = 1e3, 1e6, 1e9


def measure_mesh(console, mesh_name, case_names, contenders, options) -> list[Row]:
    """Measure the build of one mesh, then the sections of its cases."""
    rows = measure_build(console, mesh_name, contenders, min(options.rounds, BUILD_ROUNDS))
    for name in case_names:
        case = cases.make_case(name, options.queries)
        console.print(f"\n[bold]{case}")
        for section, question, by_fives in _sections(case):
            able = [each for each in contenders if question in each.questions]
            if able:
                rows += measure_questions(console, case, section, question, by_fives, able, options.rounds)
    return rows


def measure_build(console, mesh_name, contenders, round_count) -> list[Row]:
    """Time the building of each contender's structure, and leave every contender with one.

    Ratios are to this package's tree alone: like the others it has no bodies and no sign.
    """
    vertices, faces = cases.load_mesh(mesh_name)
    main_ones = {each.name: each for each in contenders if not each.is_variant}
    runs = {name: each.builder(vertices, faces) for name, each in main_ones.items()}
    samples = interleave(runs, round_count)
    for each in contenders:
        each.build(vertices, faces)
    times = {name: found.divided_by(NS_PER_MS) for name, found in samples.items()}
    base = OUR_TREE if OUR_TREE in times else min(times, key=lambda name: times[name].median)
    rows = [
        make_row(
            BUILD,
            f"{mesh_name}, {len(faces)} faces",
            name,
            each.version,
            "ms",
            times[name],
            times_ours=times[name].relative_to(times[base]),
            beside=base,
            bytes_per_face=each.memory_bytes / len(faces) if each.memory_bytes else None,
        )
        for name, each in main_ones.items()
    ]
    print_rows(console, f"{BUILD}, {rows[0].case}", rows)
    return rows


def measure_questions(console, case, section, question, by_fives, contenders, round_count) -> list[Row]:
    """Compare the answers, then time them: a batch in one call, or five at a time."""
    agreements = check_all(case, question, contenders, by_fives=by_fives)
    if by_fives:
        runs = {each.name: _in_turn(each, case, question) for each in contenders}
        counts = dict.fromkeys(runs, 1)
    else:
        runs = {each.name: ask(each, case, question).run for each in contenders}
        everything = len(case.points)
        counts = {each.name: min(everything, each.query_limit or everything) for each in contenders}
    samples = interleave(runs, round_count)
    times = {name: found.divided_by(NS_PER_US * counts[name]) for name, found in samples.items()}
    base = OURS if OURS in times else min(times, key=lambda name: times[name].median)
    beside = {each.name: each.beside if each.beside in times else base for each in contenders}
    rows = [
        make_row(
            section,
            case.name,
            each.name,
            each.version,
            "µs a call" if by_fives else "µs a query",
            times[each.name],
            times_ours=times[each.name].relative_to(times[beside[each.name]]),
            beside=beside[each.name],
            agreement=agreements[each.name],
        )
        for each in contenders
    ]
    print_rows(console, f"{section}, {case.name}", rows)
    return rows


def measure_processes(console, round_count) -> list[Row]:
    """Time this package's commands as whole processes, from start to end."""
    with tempfile.TemporaryDirectory(prefix=TEMPORARY_PREFIX) as folder:
        samples = interleave(command_runs(folder), round_count)
    version = Proximity().version
    times = {name: found.divided_by(NS_PER_S) for name, found in samples.items()}
    rows = [make_row(PROCESS, name, OURS, version, "s", found) for name, found in times.items()]
    for row in rows:
        print_rows(console, row.case, [row])
    return rows


def _sections(case):
    """Return section, question, and whether it is in calls of five."""
    if case.directions is not None:
        return (RAYS, "cast", False), (FIVE_RAYS, "cast", True)
    return (
        (POINTS, "distance", False),
        (SIGNED, "signed_distance", False),
        (FIVE_SIGNED, "signed_distance", True),
    )


def _in_turn(contender, case, question):
    """Return a call of five queries, different ones each time."""
    next_run = itertools.cycle([ask(contender, hand, question).run for hand in cases.hands_of(case)])
    return lambda: next(next_run)()
