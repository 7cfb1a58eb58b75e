"""Saves pages' pictures in few colours. ``python -m bench.pages.NAME doc/algorithms/NAME.png`` draws one."""

from pathlib import Path

from PIL import Image

from bench.common.plotting import plt

__all__ = ["plt", "save"]


def save(figure: plt.Figure, picture: Path, colours: int = 256) -> None:
    """Save a figure with a palette, which takes half of the room."""
    figure.savefig(picture, metadata={"Software": None})
    Image.open(picture).convert("P", palette=Image.Palette.ADAPTIVE, colors=colours).save(
        picture, optimize=True
    )
