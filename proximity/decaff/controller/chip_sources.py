"""C99 sources of a drum's controller, with settings and finger paths in a generated file.

Only ``decaff_glove.c`` changes with a new calibration of a glove or with another drum.
"""

import os
from collections.abc import Sequence

from proximity.decaff.controller.compiled import SETTINGS, SOURCE
from proximity.decaff.controller.records import controller_header
from proximity.decaff.controller.settings import ControllerSettings
from proximity.decaff.glove.calibrated_glove import CalibratedGlove
from proximity.decaff.glove.finger_path import FingerPath
from proximity.decaff.glove.glove import Glove
from proximity.message.c_header import header_text
from proximity.system.whole_file import write_files

NUMBERS_A_LINE = 4


def controller_sources(
    gloves: Sequence[Glove | CalibratedGlove], settings: ControllerSettings | None = None
) -> dict[str, str]:
    """Return the texts of a controller's files by file name.

    *gloves*: one for all fingers, or one for each.
    """
    paths = [FingerPath(glove) for glove in gloves]
    settings = settings or ControllerSettings(drum=paths[0].drum)
    return {
        "proximity_message.h": header_text(),
        "decaff_controller.h": controller_header(int(settings.record()[0].steady_samples)),
        "decaff_controller.c": SOURCE.read_text(encoding="ascii"),
        "decaff_glove.c": _glove_text(paths, settings),
    }


def write_controller(
    gloves: Sequence[Glove | CalibratedGlove],
    folder: str | os.PathLike[str],
    settings: ControllerSettings | None = None,
) -> list[str]:
    """Write the files of `controller_sources` into a folder, and return their paths.

    The folder is created if it does not exist.
    """
    return list(write_files(controller_sources(gloves, settings), folder))


def _number_text(value: float) -> str:
    """Return a number as C source text that is exact to the last bit."""
    if isinstance(value, int):
        return f"INT64_C({value})" if value > 2**31 else str(value)
    return "((double)INFINITY)" if value == float("inf") else repr(value)


def _settings_text(settings: ControllerSettings) -> str:
    record = settings.record()[0]
    lines = [f"    .{name} = {_number_text(record[name].item())}" for name in SETTINGS.names or ()]
    return "static const decaff_settings settings = {\n" + ",\n".join(lines) + "\n};\n"


def _glove_text(paths: Sequence[FingerPath], settings: ControllerSettings) -> str:
    """Return the text of ``decaff_glove.c``, which contains the settings and the tables of all paths."""
    texts = [
        "/* decaff_glove.c: settings, and paths of fingers. Made by `proximity controller`. */\n"
        f'#include "decaff_controller.h"\n\n#include <math.h>\n\n{_settings_text(settings)}'
    ]
    rows = []
    for number, path in enumerate(paths):
        names = ("bends", "positions", "angles")
        texts += [
            _array_text(f"{name}_{number}", values) for name, values in zip(names, path.tables(), strict=True)
        ]
        listed = ", ".join(f"{name}_{number}" for name in names)
        rows.append(f"    {{sizeof bends_{number} / sizeof bends_{number}[0], {listed}, &settings}},")
    rows[-1] = rows[-1].removesuffix(",")
    table = "\n".join(rows)
    count = "const size_t decaff_path_count = sizeof decaff_paths / sizeof decaff_paths[0];\n"
    return "\n".join([*texts, f"const decaff_path decaff_paths[] = {{\n{table}\n}};\n{count}"])


def _array_text(name: str, values: Sequence[float]) -> str:
    numbers = [_number_text(value) for value in values]
    lines = [
        ", ".join(numbers[first : first + NUMBERS_A_LINE]) for first in range(0, len(numbers), NUMBERS_A_LINE)
    ]
    joined = ",\n    ".join(lines)
    return f"static const decaff_real {name}[{len(numbers)}] = {{\n    {joined}\n}};\n"
