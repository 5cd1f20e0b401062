"""``proximity controller``: the drum's controller as C99 sources for a microcontroller."""

from pathlib import Path
from typing import Annotated

import typer

from proximity.cli.options import CABLE, GLOVES, cable_stiffness, check_gear, check_range, designed

HELP = "\n\n".join(
    (
        "Write the controller of a contact drum as C99 sources for a microcontroller.",
        "It receives frames from udp://, with or without a key, and decides at a fixed rate where each drum "
        "stands. States, limits, safe behaviour and servo are those of the controller in proximity drum. It "
        "needs no heap, from <math.h> only sqrt, and a processor with double precision, such as a "
        "Cortex-M7. With --glove, decaff_glove.c contains the finger paths of your "
        "glove, and the constants are those of its motor, gear and lever, as measured: run this "
        "command again after each calibration. With --cable the drum makes up for the stretch of the cable "
        "while it holds a position, from the measured force, or else from that of the motor.",
    )
)

EXAMPLES = """
Examples:
  proximity controller --out firmware
  proximity controller --out firmware --glove glove.json
  proximity controller --out firmware --glove glove.json --cable glove.json
"""

LEAST_RATE_HZ, MOST_RATE_HZ = 150.0, 20000.0  # slower, each sample would trip the watchdog of 10 ms


def command(
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder to write the files to.")],
    glove: GLOVES = None,
    drum: Annotated[
        str | None,
        typer.Option("--drum", metavar="GEAR", help="Another gear: gear14, gear51 or gear111 (total)."),
    ] = None,
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
    from proximity.decaff.glove.glove import Glove, with_gear
    from proximity.decaff.glove.glove_set import read_any_glove

    gear, gloves = check_gear(drum), [read_any_glove(path) for path in glove or ()] or [Glove()]
    first = designed(gloves[0])
    tip_drum = (first if gear is None else with_gear(first, gear)).tip_drum()
    rule = CableRule() if cable is None else CableRule(cable_stiffness(cable))
    for path in write_controller(gloves, out, ControllerSettings(rate, tip_drum, cable=rule)):
        typer.echo(f"{path}: written")
