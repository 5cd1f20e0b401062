"""The sources of a drum's controller in C99: templates beside this file, with constants and tables filled in.

Constants, enumerations and the layout of messages come from the tables that the Python controller uses. The
tables of the finger's path are a file of their own: a glove that is calibrated anew changes that file alone.
"""

import os
from collections.abc import Sequence
from pathlib import Path

from proximity.decaff.chip.constants import ChipSettings, constants_text, number_text
from proximity.decaff.controller.controller_states import DrumState, Trust
from proximity.decaff.drum.drum_command import DriveMode
from proximity.decaff.glove.calibrated_glove import CalibratedGlove
from proximity.decaff.glove.finger_path import FingerPath
from proximity.decaff.glove.glove import Glove
from proximity.message.c_header import enum_text, header_text
from proximity.message.clients import write_sources

ENUMS = {"drum_state": DrumState, "trust": Trust, "drive_mode": DriveMode}
NUMBERS_A_LINE = 4


def controller_sources(
    gloves: Sequence[Glove | CalibratedGlove], settings: ChipSettings | None = None
) -> dict[str, str]:
    """Return the files of a controller: their texts by their names.

    Parameters
    ----------
    gloves : sequence of Glove or CalibratedGlove
        One for all fingers, or one each.
    settings : ChipSettings
        What the controller is made for.

    Raises
    ------
    DecaffError
        If a drum cannot stand in its finger's path, or the settings cannot be used.
    """
    paths = [FingerPath(glove) for glove in gloves]
    settings = settings or ChipSettings(drum=paths[0].drum)
    kinds = {
        "RATE_TEXT": f"{settings.rate:g}",
        "CONSTANTS": constants_text(settings, len(paths)),
        "ENUMS": "\n\n".join(enum_text(name, values) for name, values in ENUMS.items()),
    }
    header = _template("decaff_controller.h.in")
    for name, value in kinds.items():
        header = header.replace(f"@{name}@", value)
    return {
        "decaff_message.h": header_text(),
        "decaff_controller.h": header,
        "decaff_controller.c": _template("decaff_controller.c.in"),
        "decaff_glove.c": _glove_text(paths),
    }


def write_controller(
    gloves: Sequence[Glove | CalibratedGlove],
    folder: str | os.PathLike[str],
    settings: ChipSettings | None = None,
) -> list[str]:
    """Write the files of a controller into a folder, and return their paths.

    Parameters
    ----------
    gloves, settings
        As of `controller_sources`.
    folder : path
        Where to; made where it is not there.

    Raises
    ------
    DecaffError
        As of `controller_sources`.
    ProximityError
        If the folder cannot be made, or a file not be written.
    """
    return list(write_sources(controller_sources(gloves, settings), folder))


def _template(name: str) -> str:
    return Path(__file__).with_name(name).read_text(encoding="ascii")


def _glove_text(paths: Sequence[FingerPath]) -> str:
    """The tables of all paths."""
    texts = [
        "/* decaff_glove.c: the paths of the fingers. Made by `proximity controller`; changes are lost. */\n"
        '#include "decaff_controller.h"\n'
    ]
    rows = []
    for number, path in enumerate(paths):
        names = ("bends", "positions", "angles")
        texts += [
            _array_text(f"{name}_{number}", values) for name, values in zip(names, path.tables(), strict=True)
        ]
        listed = ", ".join(f"{name}_{number}" for name in names)
        rows.append(f"    {{sizeof bends_{number} / sizeof bends_{number}[0], {listed}}},")
    rows[-1] = rows[-1].removesuffix(",")
    table = "\n".join(rows)
    return "\n".join([*texts, f"const decaff_path decaff_paths[DECAFF_PATH_COUNT] = {{\n{table}\n}};\n"])


def _array_text(name: str, values: Sequence[float]) -> str:
    numbers = [number_text(value) for value in values]
    lines = [
        ", ".join(numbers[first : first + NUMBERS_A_LINE]) for first in range(0, len(numbers), NUMBERS_A_LINE)
    ]
    joined = ",\n    ".join(lines)
    return f"static const decaff_real {name}[{len(numbers)}] = {{\n    {joined}\n}};\n"
