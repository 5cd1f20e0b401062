"""``proximity controller``: the drum's controller as C99 sources for a microcontroller."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from proximity.cli.options import CABLE, cable_stiffness, check_range

HELP = "\n\n".join(
    (
        "Write the controller of a contact drum as C99 sources for a microcontroller.",
        "It receives frames from udp://, with or without a key, and decides at a fixed rate where each drum "
        "stands. States, limits, safe behaviour and servo are those of the controller in proximity drum. It "
        "needs no heap, from <math.h> only sqrt, and a processor with double precision, such as a "
        "Cortex-M7. With --calibration, decaff_glove.c contains the finger paths of your glove: run this "
        "command again after each calibration. With --cable the drum makes up for the stretch of the cable "
        "while it holds a position, from the measured force, or else from that of the motor.",
    )
)

EXAMPLES = """
Examples:
  proximity controller --out firmware
  proximity controller --out firmware --calibration glove.json --drum gear10
  proximity controller --out firmware --calibration glove.json --cable glove.json
"""

LEAST_RATE_HZ, MOST_RATE_HZ = 150.0, 20000.0  # slower, each sample would trip the watchdog of 10 ms


class DrumName(StrEnum):
    """A drum whose servo is known."""

    direct = "direct"
    gear4 = "gear4"
    gear10 = "gear10"


def command(
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder to write the files to.")],
    calibration: Annotated[
        list[Path] | None,
        typer.Option(
            "--calibration",
            metavar="FILE",
            help="Calibration of the glove: one for all, or one for each finger. Default: the paper's.",
        ),
    ] = None,
    drum: Annotated[
        DrumName, typer.Option("--drum", metavar="direct|gear4|gear10", help="Drum to control.")
    ] = DrumName.gear4,
    rate: Annotated[
        float, typer.Option("--rate", metavar="HZ", help="Rate of controller and servo.")
    ] = 3000.0,
    cable: CABLE = None,
) -> None:
    """Write the files of the controller."""
    check_range(rate, "--rate", "Hz", LEAST_RATE_HZ, MOST_RATE_HZ)
    # NumPy and SciPy: only now, so that --help answers at once.
    from proximity.decaff.chip.sources import write_controller
    from proximity.decaff.controller.cable_stretch import CableRule
    from proximity.decaff.controller.settings import ControllerSettings
    from proximity.decaff.drum.drum_model import DRUMS
    from proximity.decaff.glove.glove import Glove
    from proximity.decaff.glove.glove_set import read_glove

    gloves = [read_glove(path) for path in calibration] if calibration else [Glove()]
    rule = CableRule() if cable is None else CableRule(cable_stiffness(cable))
    for path in write_controller(gloves, out, ControllerSettings(rate, DRUMS[drum.value], cable=rule)):
        typer.echo(f"{path}: written")
