"""Pictures, all in one style; every function returns a figure, and `save` writes it."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any, Literal

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter, LogLocator, MaxNLocator, NullFormatter

TRUTH, ESTIMATE, OTHER, QUIET = "#222222", "#0072b2", "#d55e00", "#bbbbbb"
mpl.rcParams.update(
    {
        "font.size": 9.5,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.grid": True,
        "grid.color": "#e6e6e6",
        "axes.axisbelow": True,
        "legend.frameon": False,
        "lines.linewidth": 1.3,
        "savefig.dpi": 130,
    }
)


def new_figure(width: float, height: float, rows: int = 1, columns: int = 1, **options: Any) -> tuple[Figure, Any]:
    """Return a figure of `rows` × `columns` axes in the house style, size in inches."""
    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots(rows, columns, **options)


def make_log(axis: Axes, side: Literal["x", "y"], values: np.ndarray) -> None:
    """Make an axis of positive values logarithmic, with ticks that name numbers and leave room between.

    Args:
        axis: of a drawing.
        side: which of its two.
        values: what it shows; nothing is done unless all that are finite are positive.
    """
    values = values[np.isfinite(values)]
    if not values.size or not values.min() > 0.0:
        return
    axis.set_xscale("log") if side == "x" else axis.set_yscale("log")
    own = axis.xaxis if side == "x" else axis.yaxis
    low, high = float(values.min()), float(values.max())
    if high < 5.0 * low:
        # Too few of 1, 2 and 5 lie within: round numbers, evenly spaced.
        own.set_major_locator(MaxNLocator(4))
    else:
        own.set_major_locator(LogLocator(subs=(1.0,) if high > 1e3 * low else (1.0, 2.0, 5.0), numticks=8))
    own.set_major_formatter(FormatStrFormatter("%g"))
    own.set_minor_formatter(NullFormatter())


def thin(places: np.ndarray, most: int) -> np.ndarray:
    """Return about `most` of the places, evenly spread, the last of them kept."""
    stride = max(1, len(places) // most)
    return places if stride == 1 else np.append(places[:-1:stride], places[-1:])


def plain(text: str) -> str:
    """Return text that is drawn as it is: no mathematics between dollar signs."""
    return text.replace("$", r"\$")


def save(figure: Figure, path: Path) -> Path:
    """Write a figure and return its path."""
    from tuning.files.errors import input_error

    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path)
    except OSError as error:
        raise input_error(path, f"cannot be written ({error.strerror})", "check the folder and the disk") from None
    return path


WIDTH = 5.6


def quantiles(values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the 5, 50 and 95 % quantiles over the rows, passing over NaN; NaN where there is nothing else."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        low, middle, high = np.nanquantile(values, (0.05, 0.5, 0.95), axis=0)
    return low, middle, high
