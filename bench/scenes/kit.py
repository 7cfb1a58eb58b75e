"""What all scenes share: how pulses are spread, and how scenes are listed."""

import inspect
from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray


def scan_rows(
    low: NDArray[np.float64], high: NDArray[np.float64], density: float, random: np.random.Generator
) -> NDArray[np.float64]:
    """Return positions in rows along x over a rectangle, one somewhere in every square of 1/density."""
    spacing = 1 / np.sqrt(density)
    columns, rows = np.ceil((high - low) / spacing).astype(int)
    cell = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)
    return low + (cell + random.random(cell.shape)) * spacing


def functions_of(*modules: ModuleType) -> dict[str, Callable[..., Any]]:
    """Return the public functions of modules by name, in the order in which they stand there."""
    return {
        name: function
        for module in modules
        for name, function in vars(module).items()
        if inspect.isfunction(function)
        and function.__module__ == module.__name__
        and not name.startswith("_")
    }
