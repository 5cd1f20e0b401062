"""Parallel projection: from the scene's frame to the pixels of an image."""

from dataclasses import dataclass

import numpy as np

from proximity.errors import QueryError

TO_VIEWER = {
    "iso": (1.0, -0.85, 0.75),
    "front": (0.0, -1.0, 0.0),
    "back": (0.0, 1.0, 0.0),
    "left": (-1.0, 0.0, 0.0),
    "right": (1.0, 0.0, 0.0),
    "top": (0.0, 0.0, 1.0),
    "bottom": (0.0, 0.0, -1.0),
}
"""Direction from the part to the viewer, in the scene's frame; z is up."""
MARGIN = 0.10  # of the image, free on each side
SMALLEST_EXTENT = 1e-9  # m: a single point fills no image


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """Where the viewer stands, and how many metres a pixel shows."""

    screen_from_scene: np.ndarray  # (3, 3), rows: right, up, to the viewer
    center: np.ndarray  # (3,) m, scene's frame, in the middle of the image
    meters_per_pixel: float
    size: tuple[int, int]  # width, height, pixels

    @classmethod
    def fitted(cls, view: str, points: np.ndarray, size: tuple[int, int]) -> "Camera":
        """Return the camera that shows all *points* as large as possible.

        *points*: (N, 3) m, scene's frame.
        """
        turn = rotation_of(view)
        seen = points @ turn.T
        lower, upper = seen.min(axis=0), seen.max(axis=0)
        extent = np.maximum(upper - lower, SMALLEST_EXTENT)
        pixels = (1 - 2 * MARGIN) * np.array(size)
        scale = float((extent[:2] / pixels).max())
        return cls(turn, turn.T @ ((lower + upper) / 2), scale, size)

    def resized(self, factor: int) -> "Camera":
        """Return the same view with *factor* times as many pixels a side."""
        width, height = self.size
        return Camera(
            self.screen_from_scene,
            self.center,
            self.meters_per_pixel / factor,
            (factor * width, factor * height),
        )

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """Return right, down and depth of points, in pixels from the upper left corner; depth grows away.

        *points*: (..., 3) m, scene's frame.
        """
        seen = (points - self.center) @ self.screen_from_scene.T / self.meters_per_pixel
        half = np.array([self.size[0] / 2, self.size[1] / 2, 0.0])
        pixels: np.ndarray = seen * [1.0, -1.0, -1.0] + half
        return pixels

    def rays(self) -> tuple[np.ndarray, np.ndarray]:
        """Return a point behind each pixel's middle, at depth 0, (H, W, 3), and the direction away, (3,)."""
        width, height = self.size
        right, down = np.meshgrid(np.arange(width) + 0.5 - width / 2, np.arange(height) + 0.5 - height / 2)
        flat = np.stack([right, -down], axis=-1) * self.meters_per_pixel
        return flat @ self.screen_from_scene[:2] + self.center, -self.screen_from_scene[2]


def rotation_of(view: str) -> np.ndarray:
    """Return the rotation with the rows right, up and to the viewer."""
    if view not in TO_VIEWER:
        raise QueryError(f"no view {view!r}, expected one of {', '.join(TO_VIEWER)}")
    back = np.array(TO_VIEWER[view]) / np.linalg.norm(TO_VIEWER[view])
    # Seen from above or below, y points up in the image.
    up = np.array([0.0, 0.0, 1.0]) if abs(back[2]) < 1.0 else np.array([0.0, np.sign(back[2]), 0.0])
    right = np.cross(up, back) / np.linalg.norm(np.cross(up, back))
    return np.array([right, np.cross(back, right), back])
