"""Pictures of a bent finger: in a terminal in the dots of Braille letters, on a page as SVG."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from proximity.decaff.glove.glove import Glove

COLUMNS, ROWS = 38, 13  # letters of 2 by 4 dots
LEFT, RIGHT = -0.040, 0.100  # m, what is shown of the finger's plane
TOP = 0.012  # m
EMPTY = "\u2800"
DOTS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))  # of a letter, by row and column
LINE_SAMPLES = np.linspace(0.0, 1.0, 120)
THICKNESS = 0.004  # m, of a finger's drawn sides about its bones


def pose_picture(glove: Glove, bend: float) -> list[str]:
    """Return lines of text: back of the hand and finger, seen from the side."""
    canvas = np.zeros((4 * ROWS, 2 * COLUMNS), bool)
    joints = [np.zeros(2), *_joints(glove, bend)]
    for start, end in pairwise(joints):
        along = (end - start) / np.hypot(*(end - start))
        side = THICKNESS * np.array([-along[1], along[0]])
        for shift in (side, -side):
            _line(canvas, start + shift, end + shift)
    _circle(canvas, joints[-1], glove.finger.pad_radius)
    for offset in (THICKNESS, -THICKNESS):
        _line(canvas, np.array([LEFT, offset]), np.array([0.0, offset]))
    lines = [_letters(canvas[4 * row : 4 * row + 4]).rstrip(EMPTY) for row in range(ROWS)]
    return "\n".join(lines).strip("\n").split("\n")


def pose_drawing(glove: Glove, bend: float) -> str:
    """Return an SVG of the same: back of the hand and finger, its joints, and the path of the fingertip."""
    joints = [np.zeros(2), *_joints(glove, bend)]
    path = [_joints(glove, each)[-1] for each in np.linspace(0.0, 1.0, 61)]
    lower = 1e3 * min(point[1] for point in path) - 14.0
    left, right = 1e3 * LEFT, 1e3 * max(point[0] for point in path) + 14.0
    wide = 2e3 * glove.finger.pad_radius
    dots = "".join(f'<circle cx="{x:.2f}" cy="{y:.2f}" r="1.6"/>' for x, y in _screen(joints[:-1]))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{6 * (right - left):.0f}" '
        f'height="{6 * (14.0 - lower):.0f}" viewBox="{left:.1f} -14 {right - left:.1f} {14.0 - lower:.1f}" '
        'fill="none" stroke-linecap="round" stroke-linejoin="round">'
        f'<polyline points="{_points(path)}" stroke="#9fb6cc" stroke-width="0.6" stroke-dasharray="1.5 2"/>'
        f'<polyline points="{left - 20:.1f},0 0,0" stroke="#d9a98c" stroke-width="{1.3 * wide:.2f}"/>'
        f'<polyline points="{_points(joints)}" stroke="#edc9b0" stroke-width="{wide:.2f}"/>'
        f'<polyline points="{_points(joints)}" stroke="#7a4f35" stroke-width="0.7"/>'
        f'<g fill="#7a4f35">{dots}</g></svg>'
    )


def joint_angles(glove: Glove, bend: float) -> str:
    """Return the angles of the three joints at a bend, in words."""
    knuckle, middle, last = (round(np.degrees(bend * flexion)) for flexion in glove.finger.flexions)
    return f"knuckle {knuckle}°, middle joint {middle}°, last joint {last}°"


def _joints(glove: Glove, bend: float) -> list[np.ndarray]:
    angles = -bend * np.cumsum(glove.finger.flexions)
    steps = np.stack([np.cos(angles), np.sin(angles)], axis=-1) * np.array(glove.finger.phalanges)[:, None]
    return list(np.cumsum(steps, axis=0))


def _screen(points: Sequence[np.ndarray]) -> np.ndarray:
    """Millimetres, downwards."""
    return np.array([1e3, -1e3]) * np.array(points)


def _points(points: Sequence[np.ndarray]) -> str:
    return " ".join(f"{x:.2f},{y:.2f}" for x, y in _screen(points))


def _line(canvas: np.ndarray, start: np.ndarray, end: np.ndarray) -> None:
    _dots(canvas, start + LINE_SAMPLES[:, None] * (end - start))


def _circle(canvas: np.ndarray, middle: np.ndarray, radius: float) -> None:
    turn = 2.0 * np.pi * LINE_SAMPLES
    _dots(canvas, middle + radius * np.stack([np.cos(turn), np.sin(turn)], axis=-1))


def _dots(canvas: np.ndarray, points: np.ndarray) -> None:
    scale = canvas.shape[1] / (RIGHT - LEFT)
    columns = np.rint((points[:, 0] - LEFT) * scale).astype(int)
    rows = np.rint((TOP - points[:, 1]) * scale).astype(int)
    is_in = (columns >= 0) & (columns < canvas.shape[1]) & (rows >= 0) & (rows < canvas.shape[0])
    canvas[rows[is_in], columns[is_in]] = True


def _letters(dots: np.ndarray) -> str:
    codes = sum(
        (dots[row, column::2].astype(int) * DOTS[row][column] for row in range(4) for column in range(2)),
        np.zeros(COLUMNS, int),
    )
    return "".join(chr(0x2800 + code) for code in codes.tolist())
