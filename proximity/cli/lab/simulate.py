"""Command ``proximity simulate``, which compares a press on a wall with a press on a real wall."""

from pathlib import Path
from typing import Annotated

from proximity.cli.lab.press_options import PartOptions, WallOptions
from proximity.cli.options import JSON_SI, option, with_option_groups
from proximity.cli.output import report


@with_option_groups
def simulate(
    surface: WallOptions,
    pressed: PartOptions,
    out: Annotated[
        Path | None, option("FILE", "Write the press as CSV, about every 0.1 ms.", "--csv")
    ] = None,
    as_json: JSON_SI = False,
) -> None:
    """Simulate a hand that presses on a wall, and compare the force with that of a real wall.

    The hand approaches at --speed, presses with 0.8 N and leaves. A coupled wall is a spring and a
    damper, rendered by a motor on the finger; without --stiffness and --damping the best pair of a grid
    is used. A decaff wall is a drum that moves to the reported position of the wall; --policy chooses
    the conversion of a distance to a position; --cable inserts a cable between finger and drum. --glove
    reads motor, gear, lever, cable and measured latency from the file of your glove. --csv writes the
    press, about every 0.1 ms.

    With --scene the wall is a CAD part, and the engine controls the drum: the tracker on the finger's
    path, frames with the latency of --latency, and the drum's controller. The result is compared
    with the ideal distance in the same loop, and with the true surface. --stiffness and --damping make
    the part deformable.

    Examples:
      proximity simulate
      proximity simulate --speed 0.5 --latency 10 --policy latched --csv late.csv
      proximity simulate --cable 1212 --stretch torque
      proximity simulate --glove glove.json --stretch torque
      proximity simulate --wall coupled --latency 3 --stiffness 734 --damping 4.4 --json
      proximity simulate --scene bracket.stl --at 48 30 20 --latency 10 --csv bracket.csv
    """
    pressed.check()
    if pressed.scene is None:
        surface.check()
    else:
        surface.check_on_part()
    from proximity.cli.lab.press import simulate_press, simulate_press_on_part

    if pressed.scene is None:
        simulate_press(surface, out, as_json=as_json)
    else:
        simulate_press_on_part(surface, pressed, out, as_json=as_json)
    if out is not None:
        report(f"wrote {out}")
