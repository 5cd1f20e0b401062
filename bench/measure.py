"""The sections of the comparison: each returns rows, and prints them as soon as it has them."""

import itertools

from agreement import ask, check_all
from processes import command_runs, temporary_folder
from results import BUILD, FEW_RAYS, FEW_SIGNED, OUR_TREE, OURS, POINTS, PROCESS, RAYS, SIGNED, Row, make_row
from tables import print_rows
from timing import interleave

import cases
import rivals

BUILD_ROUNDS, PROCESS_ROUNDS = 5, 5
NS_PER_US, NS_PER_MS, NS_PER_S = 1e3, 1e6, 1e9


def measure_mesh(console, mesh_name, case_names, contenders, options) -> list[Row]:
    """Everything about one mesh: its build, then the sections of its cases."""
    rows = measure_build(console, mesh_name, contenders, min(options.rounds, BUILD_ROUNDS))
    for name in case_names:
        case = cases.make_case(name, options.queries)
        console.print(f"\n[bold]{case}")
        for section, question, is_few in _sections(case):
            able = [each for each in contenders if question in each.questions]
            if able:
                rows += measure_questions(console, case, section, question, is_few, able, options.rounds)
    return rows


def measure_build(console, mesh_name, contenders, round_count) -> list[Row]:
    """Time the making of each structure, and leave every contender with one.

    Ratios are to our tree alone: like the others' it knows of no bodies and no sign.
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


def measure_questions(console, case, section, question, is_few, contenders, round_count) -> list[Row]:
    """Compare the answers, then time them: a batch in one call, or five at a time."""
    agreements = check_all(case, question, contenders, is_few=is_few)
    if is_few:
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
            "µs a call" if is_few else "µs a query",
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
    """Time our commands as whole processes, from start to end."""
    with temporary_folder() as folder:
        samples = interleave(command_runs(folder), round_count)
    version = rivals.Proximity().version
    times = {name: found.divided_by(NS_PER_S) for name, found in samples.items()}
    rows = [make_row(PROCESS, name, OURS, version, "s", found) for name, found in times.items()]
    for row in rows:
        print_rows(console, row.case, [row])
    return rows


def _sections(case):
    """Section, question, and whether it is asked five at a time."""
    if case.directions is not None:
        return (RAYS, "cast", False), (FEW_RAYS, "cast", True)
    return (
        (POINTS, "distance", False),
        (SIGNED, "signed_distance", False),
        (FEW_SIGNED, "signed_distance", True),
    )


def _in_turn(contender, case, question):
    """A call that asks for five queries, at another place each time."""
    next_run = itertools.cycle([ask(contender, hand, question).run for hand in cases.hands_of(case)])
    return lambda: next(next_run)()
