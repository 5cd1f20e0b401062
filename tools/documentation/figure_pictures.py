"""Regenerate the figures of the documentation: ``python tools/documentation/figure_pictures.py``.

They are those of ``proximity figures``, reduced for fast loading.
"""

import tempfile
from pathlib import Path

from PIL import Image

from proximity.lab.figures.catalogue import write_figure

PICTURES = Path(__file__).resolve().parents[2] / "docs" / "pictures"
FIGURES = ("5", "stability", "error-latency", "drum-motion")
WIDEST, COLOURS = 1400, 64  # pixels; of a palette


def main() -> None:
    """Draw each figure and write it among the pictures."""
    with tempfile.TemporaryDirectory() as folder:
        for name in FIGURES:
            drawn, _ = write_figure(name, folder)
            image = Image.open(drawn).convert("RGB")
            image.thumbnail((WIDEST, 2 * WIDEST))
            image.quantize(COLOURS).save(PICTURES / drawn.name, optimize=True)


if __name__ == "__main__":
    main()
