"""Captions below figures: what the curves were computed with, and whose numbers these are."""

import textwrap
from typing import TYPE_CHECKING

from proximity.decaff.drum.drum_model import Drum
from proximity.decaff.drum.servo import SERVO_RATE
from proximity.lab.simulation.hand import Hand

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SIZE = 5.5  # points
LETTERS_AN_INCH = 23  # of that size, about
COLOUR = "0.35"
COINCIDE = "Where fewer curves are seen, several lie on one another."


def caption(figure: "Figure", *lines: str) -> None:
    """Put text below a figure."""
    most = int(LETTERS_AN_INCH * figure.get_figwidth())
    wrapped = [part for line in lines for part in textwrap.wrap(line, most)]
    figure.supxlabel("\n".join(wrapped), fontsize=SIZE, color=COLOUR)


def hand_words(hand: Hand) -> str:
    """Return who presses: pad and finger, and the hand behind them."""
    return (
        f"Pad {hand.pad_stiffness:g} N/m, {hand.pad_damping:g} N·s/m (the paper's); finger "
        f"{1e3 * hand.finger_mass:g} g, hand {hand.stiffness:g} N/m, {hand.damping:g} N·s/m (ours)"
    )


def gears_words(drum: Drum) -> str:
    """Return what drums have in common that differ in their gear, which is their name."""
    return f"{drum.motor.name}, total gearing as named, on a lever of {1e3 * drum.lever:.0f} mm"


def drum_words(drum: Drum) -> str:
    """Return what a drum is, and how it acts at the fingertip."""
    return (
        f"drum {drum.words}: {1e3 * drum.mass:.0f} g, servo at {1e-3 * SERVO_RATE:g} kHz, encoder "
        f"{1e6 * drum.resolution:.1f} µm with the wall at random within a count (ours)"
    )
