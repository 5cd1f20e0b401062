"""Draw the drum with its stop, and the wiring of its brake: ``python tools/documentation/drum_drawing.py``.

Angles and lengths are those of `Glove` and `FingerPath`, consistent with the settings of the controller.
"""

import math
from pathlib import Path

from proximity.decaff.glove.finger_path import FingerPath
from proximity.decaff.glove.glove import Glove
from proximity.decaff.motors.motor_driver import MotorSettings

PICTURES = Path(__file__).resolve().parents[2] / "docs" / "pictures"
SCALE, AXIS = 5.5, (290.0, 340.0)  # pixels a millimetre; of the common axis
SVG = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 760 400" font-family="sans-serif" font-size="14">'
WHITE = '<rect width="760" height="400" fill="white"/>'
LINK, STOP = 60.0, (33.0, 55.0)  # mm from the axis: the link's end, and both ends of the stop


def main() -> None:
    """Write both drawings among the pictures."""
    for name, drawn in (("drum-stop.svg", mechanics()), ("drum-wiring.svg", wiring())):
        (PICTURES / name).write_text(drawn, encoding="utf-8")


def mechanics() -> str:
    """Return the drawing as SVG: link and drum at the flat hand, the drum retracted, and the stop."""
    glove = Glove()
    retracted = FingerPath(glove).drum_angles[1]
    stop = retracted + MotorSettings.stop
    arm, roller = 1e3 * glove.drum.arm, 1e3 * glove.drum.roller_radius
    touching = float(glove.drum_angle(0.0))
    link_end = _at(LINK, touching - glove.drum.alpha)
    stop_side = stop + math.asin(roller / arm)
    x, y = AXIS
    arc_from, arc_to = _at(arm, touching), _at(arm, retracted)
    radius = SCALE * arm
    parts = [
        SVG,
        "<title>The drum of one finger from the side: link, arm with roller, and mechanical stop</title>",
        WHITE,
        '<g fill="none" stroke="black" stroke-width="2">',
        f'<path d="M{arc_from} A{radius:g} {radius:g} 0 0 0 {arc_to}" stroke="#777" stroke-dasharray="6 4"/>',
        f'<path d="M{x} {y} L{link_end}" stroke="#0072B2" stroke-width="{SCALE * 4:.0f}" opacity="0.5"/>',
        *_drum(arm, roller, touching, "#D55E00"),
        *_drum(arm, roller, retracted, "#777"),
        f'<path d="M{_at(STOP[0], stop_side)} L{_at(STOP[1], stop_side)}" stroke-width="9"/>',
        f'<circle cx="{x}" cy="{y}" r="9" fill="white"/><circle cx="{x}" cy="{y}" r="2" fill="black"/>',
        "</g>",
        *_label(430.0, 388.0, "axis of link, potentiometer and drum"),
        f'<path d="M424 383 L{x + 10} {y + 5}" stroke="black"/>',
        *_label(430.0, 355.0, "link, flat hand: 0 rad"),
        *_label(530.0, 262.0, f"drum at the flat hand: {touching:.3f} rad"),
        *_label(300.0, 52.0, f"drum retracted: {retracted:.3f} rad"),
        *_label(20.0, 52.0, f"mechanical stop: {stop:.3f} rad"),
        *_label(20.0, 230.0, f"arm {arm:g} mm to the roller's centre"),
        *_label(20.0, 252.0, f"roller {2 * roller:g} mm in diameter"),
        *_label(20.0, 274.0, f"link {1e3 * glove.drum.link_width:g} mm wide"),
        *_label(20.0, 296.0, f"drum turns {math.degrees(stop - touching):.0f}° in all"),
        *_label(470.0, 150.0, "greater angles:"),
        *_label(470.0, 170.0, "away from the finger"),
        "</svg>",
    ]
    return "\n".join(parts) + "\n"


def wiring() -> str:
    """Return the block diagram as SVG: signals, and the brake relay in series with the emergency stop."""
    boxes = (
        (20, 40, 150, "potentiometer", "bend of the link"),
        (20, 130, 150, "encoder", "angle of the motor"),
        (20, 220, 150, "network", "frames of the service"),
        (270, 90, 170, "chip", "controller, servo, start"),
        (540, 40, 190, "motor driver", "current loop, both low sides"),
        (540, 160, 190, "brake relay", "at rest: windings shorted"),
        (540, 280, 190, "motor, gear, drum", "and its mechanical stop"),
        (20, 330, 150, "24 V", "current-limited"),
        (210, 330, 140, "emergency stop", "opens the circuit"),
        (380, 330, 120, "watchdog", "1 ms, opens it too"),
    )
    wires = (
        ("M170 65 H220 V105 H270", "black", ""),
        ("M170 155 H220 V125 H270", "black", ""),
        ("M170 245 H240 V135 H270", "black", ""),
        ("M440 105 H490 V65 H540", "black", ""),
        ("M635 90 V160", "#0072B2", ""),
        ("M635 210 V280", "#0072B2", ""),
        ("M170 355 H210", "#D55E00", ""),
        ("M350 355 H380", "#D55E00", ""),
        ("M500 355 H515 V185 H540", "#D55E00", ""),
        ("M355 140 V280 H440 V330", "black", "6 4"),
    )
    parts = [
        SVG,
        "<title>Wiring: emergency stop and watchdog in series with the coil of the brake relay</title>",
        WHITE,
        '<g fill="none" stroke-width="2">',
        *(
            f'<path d="{path}" stroke="{colour}"' + (f' stroke-dasharray="{dashes}"' if dashes else "") + "/>"
            for path, colour, dashes in wires
        ),
        "</g>",
    ]
    for x, y, width, name, words in boxes:
        parts += [
            f'<rect x="{x}" y="{y}" width="{width}" height="50" rx="4" fill="#eee" stroke="black"/>',
            f'<text x="{x + width / 2:g}" y="{y + 21}" text-anchor="middle" font-weight="bold">{name}</text>',
            f'<text x="{x + width / 2:g}" y="{y + 40}" text-anchor="middle" font-size="12">{words}</text>',
        ]
    parts += [
        *_label(452.0, 122.0, "torque, mode"),
        *_label(646.0, 130.0, "windings"),
        *_label(362.0, 272.0, "restarts"),
        *_label(20.0, 318.0, "coil of the relay: without current the brake is on"),
        "</svg>",
    ]
    return "\n".join(parts) + "\n"


def _drum(arm: float, roller: float, angle: float, colour: str) -> list[str]:
    """Return arm and roller at an angle."""
    x, y = AXIS
    centre = _at(arm, angle)
    across, down = centre.split()
    return [
        f'<path d="M{x} {y} L{centre}" stroke="{colour}" stroke-width="4"/>',
        f'<circle cx="{across}" cy="{down}" r="{SCALE * roller:.1f}" fill="white" stroke="{colour}"/>',
    ]


def _at(length: float, angle: float) -> str:
    """Return a point, in pixels, at a length in mm and an angle from the axis."""
    x, y = AXIS
    return f"{x + SCALE * length * math.cos(angle):.1f} {y - SCALE * length * math.sin(angle):.1f}"


def _label(x: float, y: float, words: str) -> list[str]:
    return [f'<text x="{x:g}" y="{y:g}">{words}</text>']


if __name__ == "__main__":
    main()
