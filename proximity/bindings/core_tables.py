"""What the library in C takes from the kernels: layouts of records, numbers, sentences, and their wrappers.

Text that is generated when kernels are compiled, so that nothing is written twice. Only that imports it.
"""

import json
from collections.abc import Iterable

import numpy as np

import proximity
from proximity.kernels import layout
from proximity.kernels.geometry.morton_order import SORT_FROM
from proximity.kernels.scene.dynamic_tree import SORT_STEPS
from proximity.kernels.scene.model_validation import FAULT_SIZE, SOUND
from proximity.kernels.scene.part_trees import NEVER, STATIC_COPIES
from proximity.kernels.scene.stored_bytes import HEADER_SIZE, PAGE
from proximity.pose import ORTHONORMAL_TOLERANCE, SINGLE_TOLERANCE
from proximity.scene.model.scene_state import EXACT_ENOUGH, FARTHEST_MOVE, FASTEST_MOVE
from proximity.scene.queries.queries import SORT_RAYS_FROM, SORT_RAYS_IN
from proximity.scene.saved import archive, stored_model
from proximity.scene.saved.compiled_scene import LAYOUT

ENTRIES = (
    "closest_batch", "signed_batch", "distance_batch", "contains_batch", "cast_batch", "segment_batch",
    "morton_order", "ray_order", "fault_in_header", "fault_in_arrays", "complete_model", "first_unfit",
    "move_parts", "copies_in_use", "make_static", "thin_static", "bring_up_to_date",
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
}
_TYPES = {"f8": "double", "i8": "int64_t"}


def tables_header() -> str:
    """Return the text of ``core_tables.h``: records of kernels, numbers, and which wrapper is which."""
    lines = ["#ifndef PROXIMITY_CORE_TABLES_H", "#define PROXIMITY_CORE_TABLES_H", "#include <stdint.h>"]
    lines += [f"#define {name} {value!r}" for name, value in _NUMBERS.items()]
    lines += [f'#define PACKAGE_VERSION "{proximity.__version__}"']
    lines += _record("Frame", layout.FRAME, ()) + _record("Part", layout.PART, layout.SCENE_FIELDS)
    names = ", ".join(name.upper() for name in ENTRIES)
    return "\n".join([*lines, f"enum {{ {names}, ENTRY_COUNT }};", "#endif", ""])


def tables_source(sets: Iterable[tuple[str, dict[str, str]]], digest: str) -> str:
    """Return the text of ``core_tables.c``.

    *sets*: of each set of instructions, from the least to the best, its name, and the symbols of wrappers by
    the names of entry points. *digest*: of the sources.
    """
    sets = list(sets)
    lines = ['#include "core.h"']
    lines += [f"extern int {of[name]}(void **, void **, int64_t);" for _, of in sets for name in ENTRIES]
    lines += ["const InstructionSet proximity_sets[] = {"]
    lines += [f'    {{"{name}", {{{", ".join(of[entry] for entry in ENTRIES)}}}}},' for name, of in sets]
    lines += ["    {NULL, {NULL}}};", "const Sentence proximity_sentences[] = {"]
    sentences = archive.SENTENCES | stored_model.SENTENCES
    lines += [f"    {{{kind}, {json.dumps(text)}}}," for kind, text in sentences.items()]
    lines += ["    {0, NULL}};"]
    lines += [f"const char proximity_layout[] = {json.dumps(json.dumps(LAYOUT, separators=(',', ':')))};"]
    lines += [f'__attribute__((used)) static const char digest_of_library[] = "{digest}";']
    lines += [f'__attribute__((used)) static const char {name}[] = "for {name}";' for name, _ in sets]
    return "\n".join([*lines, ""])


def _record(name: str, record: np.dtype, aliases: Iterable[str]) -> list[str]:
    """The declaration of a record of numbers of eight bytes."""
    lines = []
    for field, (kind, *_) in sorted(record.fields.items(), key=lambda item: item[1][1]):  # type: ignore[union-attr]
        if field not in aliases:
            lengths = "".join(f"[{length}]" for length in kind.shape)
            lines.append(f"    {_TYPES[kind.base.str[1:]]} {field}{lengths};")
    return [f"typedef struct {name} {{", *lines, f"}} {name};"]
