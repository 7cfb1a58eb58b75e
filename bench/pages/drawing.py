"""
What pictures of pages are drawn with, on no screen, and saved in few colours.

They need matplotlib (``pip install matplotlib``) beside the package. ``python -m bench.pages.NAME
doc/algorithms/NAME.png`` draws that of a page.
"""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from PIL import Image

__all__ = ["plt", "save"]


def save(figure: plt.Figure, picture: Path, colours: int = 256) -> None:
    """Save a figure with a palette, which takes half of the room."""
    figure.savefig(picture, metadata={"Software": None})
    Image.open(picture).convert("P", palette=Image.Palette.ADAPTIVE, colors=colours).save(
        picture, optimize=True
    )
