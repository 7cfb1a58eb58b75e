"""matplotlib's plots, drawn on no screen; it is needed (``pip install matplotlib``) beside the package."""

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

__all__ = ["plt"]
