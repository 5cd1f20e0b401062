"""Tables for the C library from the kernels: layouts of records, numbers, sentences, and their wrappers.

The text is generated when kernels are compiled, so that each table has one source. Only the build imports
this module.
"""

import inspect
import json
from collections.abc import Iterable
from itertools import accumulate

import numpy as np

import proximity
from proximity.core import loop_records, receiver_state
from proximity.kernels import answers, layout, thresholds
from proximity.kernels.contact_record import (
    CONTACT_RECORD,
    SURFACE_DEFORMABLE,
    SURFACE_RIGID,
    unknown_contact,
)
from proximity.kernels.layout import NEVER, STATIC_COPIES
from proximity.kernels.point.coherent_search import FRONTIER_SIZE
from proximity.kernels.scene.store.model_validation import FAULT_SIZE, SOUND
from proximity.kernels.scene.store.stored_bytes import HEADER_SIZE, NO_MAGIC, OTHER_VERSION, PAGE
from proximity.kernels.thresholds import MILLIMETRES_FROM, MILLIMETRES_TO, SORT_FROM, SORT_STEPS
from proximity.kernels.tracking import motion, tracked_group, tracked_records, tracked_tick
from proximity.kernels.tracking.conservative_advancement import BALLS_SIZE
from proximity.kernels.tracking.finger_distance import CROWD
from proximity.kernels.tracking.motion import ESTIMATE, ESTIMATES
from proximity.kernels.tracking.part_drift import EIGHT_MOVERS, POSE_COLUMNS
from proximity.kernels.tracking.tick import ALL_IN_MILLIMETRES, DONE, HAS_DEFECT
from proximity.kernels.tracking.track import MAX_NS, SETTINGS, TRACK
from proximity.kernels.traverse.best_first import WORKSPACE_SIZE
from proximity.message.c_header import structure
from proximity.message.instant_advice import OTHER_CLOCK_NS
from proximity.native.signature import BUNDLES
from proximity.pose import ORTHONORMAL_TOLERANCE, SINGLE_TOLERANCE
from proximity.scene import pairs, penetration, sign
from proximity.scene.model.assembly import EXACT_ENOUGH
from proximity.scene.model.scene_state import FARTHEST_MOVE, FASTEST_MOVE
from proximity.scene.queries.queries import SORT_RAYS_FROM, SORT_RAYS_IN
from proximity.scene.saved import archive, stored_model
from proximity.scene.saved.compiled_scene import LAYOUT
from proximity.tracker import part_tracker, tracker_arguments
from proximity.tracker.tracker import GONE, Tracker

ENTRIES = (
    "closest_batch", "signed_batch", "distance_batch", "contains_batch", "cast_batch", "segment_batch",
    "morton_order", "ray_order", "fault_in_header", "fault_in_arrays", "complete_model", "first_unfit",
    "move_parts", "copies_in_use", "make_static", "thin_static", "bring_up_to_date", "forget_surfaces",
    "adopt_parts", "tick", "observe", "update_newest", "drop_stale", "sense_contacts", "connect_parts",
    "surface_faces", "decide_inside", "list_pairs", "connect_pairs", "find_exit", "deepest_point",
    "adopt_rows", "follow_parts", "relate_group", "move_group", "write_part_row", "copy_nodes",
    "plan_scene", "copy_part", "finish_scene", "split_faces", "face_topology", "signed_volume",
    "frame_of_box", "plan_part", "fill_part", "choose_sign",
)  # fmt: skip
"""The entry points that the library calls."""
_NUMBERS = {
    "SOUND": SOUND,
    "FAULT_SIZE": FAULT_SIZE,
    "NO_ROW": layout.NO_ROW,
    "FRAME_COLUMNS": layout.FRAME_COLUMNS,
    "PART_COLUMNS": layout.PART_COLUMNS,
    "HEADER_SIZE": HEADER_SIZE,
    "PAGE": PAGE,
    "NEVER": NEVER,
    "NO_MAGIC": NO_MAGIC,
    "OTHER_VERSION": OTHER_VERSION,
    "MILLIMETRES_FROM": MILLIMETRES_FROM,
    "MILLIMETRES_TO": MILLIMETRES_TO,
    "DONE": DONE,
    "HAS_DEFECT": HAS_DEFECT,
    "ALL_IN_MILLIMETRES": ALL_IN_MILLIMETRES,
    "SHORTEST_NS": tracker_arguments.SHORTEST_NS,
    "EARLY_NS": tracker_arguments.EARLY_NS,
    "MAX_SECONDS": tracker_arguments.MAX_SECONDS,
    "STATIC_COPIES": STATIC_COPIES,
    "SORT_FROM": SORT_FROM,
    "SORT_STEPS": SORT_STEPS,
    "SORT_RAYS_FROM": SORT_RAYS_FROM,
    "SORT_RAYS_IN": SORT_RAYS_IN,
    "ORTHONORMAL_TOLERANCE": ORTHONORMAL_TOLERANCE,
    "SINGLE_TOLERANCE": SINGLE_TOLERANCE,
    "EXACT_ENOUGH": EXACT_ENOUGH,
    "FARTHEST_MOVE": FARTHEST_MOVE,
    "FASTEST_MOVE": FASTEST_MOVE,
    "SURFACE_RIGID": SURFACE_RIGID,
    "SURFACE_DEFORMABLE": SURFACE_DEFORMABLE,
    "LANES": layout.LANES,
    "NODE_STRIDE": layout.NODE_STRIDE,
    "PART_GONE": GONE,
    "MOVING_MARGIN": thresholds.MOVING_MARGIN,
    "MAX_COORDINATE": thresholds.MAX_COORDINATE,
    "SMALLEST_SIZE": thresholds.SMALLEST_SIZE,
    "CONTACT_SIZE": CONTACT_RECORD.itemsize,
    "FRONTIER_SIZE": FRONTIER_SIZE,
    "BALLS_SIZE": BALLS_SIZE,
    "CROWD": CROWD,
    "ESTIMATES": ESTIMATES,
    "POSE_COLUMNS": POSE_COLUMNS,
    "WORKSPACE_SIZE": WORKSPACE_SIZE,
    "MAX_NS": MAX_NS,
    "USABLE": motion.USABLE,
    "FUTURE": motion.FUTURE,
    "TOO_OLD": motion.TOO_OLD,
    "BACKWARDS": motion.BACKWARDS,
    "AHEAD_NS": receiver_state.AHEAD_NS,
    "OTHER_CLOCK_NS": OTHER_CLOCK_NS,
    "MAX_BUDGET": tracker_arguments.MOST,
    "LONGEST_LATENCY": tracker_arguments.LONGEST_LATENCY,
    "MAX_RADIUS": tracker_arguments.MAX_RADIUS,
    "MAX_WORKING_RANGE": tracker_arguments.MAX_WORKING_RANGE,
    "DEFAULT_BUDGET": tracker_arguments.DEFAULT_BUDGET,
    "PART_HORIZON": part_tracker.HORIZON,
    "MAX_RECORDS": tracked_tick.MAX_RECORDS,
    "FRONTIER_ENTRIES": tracked_records.FRONTIER_ENTRIES,
    "SIDE": tracked_records.SIDE,
    "LINEAR_GIVEN": tracked_group.LINEAR_GIVEN,
    "ANGULAR_GIVEN": tracked_group.ANGULAR_GIVEN,
    "DEEPEST_BUDGET": penetration.DEEPEST_BUDGET,
    "MIN_TOLERANCE": pairs.MIN_TOLERANCE,
}
_DEFAULTS = "radius", "latency", "working_range", "tolerance", "horizon", "max_speed", "max_acceleration"
_RECORDS = {
    "Frame": layout.FRAME,
    "Part": layout.PART,
    "Settings": SETTINGS,
    "Track": TRACK,
    "Estimate": ESTIMATE,
    "ClearanceAnswer": answers.CLEARANCE_ANSWER,
    "PairSearch": answers.PAIR_SEARCH,
    "ExitAnswer": answers.EXIT_ANSWER,
    "DeepestAnswer": answers.DEEPEST_ANSWER,
    "HeldPair": tracked_records.HELD_PAIR,
    "HeldSettings": tracked_records.HELD_SETTINGS,
    "Connection": tracked_records.CONNECTION_RECORD,
    "EightMovers": EIGHT_MOVERS,
    **loop_records.RECORDS,
}


def tables_header() -> str:
    """Return the text of ``core_tables.h``: records of kernels, numbers, and indices of wrappers."""
    lines = [
        "#ifndef PROXIMITY_CORE_TABLES_H",
        "#define PROXIMITY_CORE_TABLES_H",
        '#include "proximity_message.h"',
    ]
    lines += [f"#define {name} {value!r}" for name, value in _NUMBERS.items()]
    lines += [f'#define PACKAGE_VERSION "{proximity.__version__}"']
    parameters = inspect.signature(Tracker).parameters
    lines += [f"#define DEFAULT_{name.upper()} {parameters[name].default!r}" for name in _DEFAULTS]
    lines += [f"#define LOOP_{name} {length}" for name, length in loop_records.LENGTHS.items()]
    for name, record in _RECORDS.items():
        lines += [structure(name, record, _RECORDS | receiver_state.RECORDS, layout.SCENE_FIELDS)]
    for prefix, bundle in (("AT", "TrackerArrays"), ("HELD", "HeldArrays"), ("GROUP", "GroupMotion")):
        arrays = BUNDLES[bundle]
        ends = accumulate((array.word_count for array in arrays.arrays), initial=0)
        places = zip((*arrays.kind._fields, "end"), ends, strict=True)
        lines += [f"enum {{ {', '.join(f'{prefix}_{name.upper()} = {at}' for name, at in places)} }};"]
    names = ", ".join(name.upper() for name in ENTRIES)
    return "\n".join([*lines, f"enum {{ {names}, ENTRY_COUNT }};", "#endif", ""])


def tables_source(sets: Iterable[tuple[str, dict[str, str]]], digest: str, digest_in_c: str = "") -> str:
    """Return the text of ``core_tables.c``.

    *sets*: for each set of instructions, in ascending order, its name, and the symbols of wrappers by the
    names of entry points. *digest*: of the sources; *digest_in_c*: of the C sources alone.
    """
    sets = list(sets)
    lines = ['#include "core.h"']
    lines += [f"extern int {of[name]}(void **, void **, int64_t);" for _, of in sets for name in ENTRIES]
    lines += ["const InstructionSet proximity_sets[] = {"]
    lines += [f'    {{"{name}", {{{", ".join(of[entry] for entry in ENTRIES)}}}}},' for name, of in sets]
    lines += ["    {NULL, {NULL}}};", "const Sentence proximity_sentences[] = {"]
    sentences = archive.SENTENCES | stored_model.SENTENCES
    lines += [f"    {{{kind}, {json.dumps(text)}}}," for kind, text in sentences.items()]
    lines += ["    {0, NULL}};", "const Sentence proximity_reasons[] = {"]
    lines += [f"    {{{kind}, {json.dumps(text)}}}," for kind, text in sign.REASONS.items()]
    exceptions = ", ".join(map(json.dumps, sign.EXCEPTIONS))
    lines += ["    {0, NULL}};", f"const char *const proximity_exceptions[] = {{{exceptions}}};"]
    lines += [f"const char proximity_flipped[] = {json.dumps(sign.FLIPPED)};"]
    lines += [f"const char proximity_layout[] = {json.dumps(json.dumps(LAYOUT, separators=(',', ':')))};"]
    words = ", ".join(f"INT64_C({word})" for word in unknown_contact().view(np.int64).tolist())
    lines += [f"const int64_t proximity_unknown_contact[] = {{{words}}};"]
    lines += [f'__attribute__((used)) static const char digest_of_library[] = "{digest}";']
    lines += [f'__attribute__((used)) static const char digest_in_c[] = "in C {digest_in_c}";']
    lines += [f'__attribute__((used)) static const char {name}[] = "for {name}";' for name, _ in sets]
    return "\n".join([*lines, ""])
