"""Answers as people look at them: a table in a notebook, a data frame, a picture.

Nothing here computes: matplotlib and pandas are imported when they are asked for, and are no needs of the library.
"""

from __future__ import annotations

from html import escape
from typing import Any

import numpy as np

_SHOWN = 12
"""Series in a picture; more would leave none of them room."""


def columns(answer: Any) -> dict[str, np.ndarray]:
    """Return the arrays of an answer by dotted name, `None` left out: `signals.torque`, `sides.0.stiffness`.

    Args:
        answer: a named tuple of arrays, and of others like it.
    """
    found: dict[str, np.ndarray] = {}

    def walk(prefix: str, value: Any) -> None:
        if value is None:
            return
        if isinstance(value, tuple):
            names = getattr(value, "_fields", range(len(value)))
            for name, inner in zip(names, value, strict=True):
                walk(f"{prefix}.{name}" if prefix else str(name), inner)
        else:
            found[prefix] = np.asarray(value)

    walk("", answer)
    return found


def to_html(answer: Any) -> str:
    """Return what an answer holds as an HTML table: of a number its value, of an array its shape and range."""
    rows = []
    for name, values in columns(answer).items():
        cells = [name, "×".join(map(str, values.shape)) or "–", *_range(values)]
        rows.append("".join(f"<td>{escape(cell)}</td>" for cell in cells))
    head = "".join(f"<th>{name}</th>" for name in ("", "shape", "least", "median", "largest", "finite"))
    body = "".join(f"<tr>{row}</tr>" for row in rows)
    caption = escape(type(answer).__name__)
    return f"<table><caption>{caption}</caption><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _range(values: np.ndarray) -> list[str]:
    numbers = values.astype(float).ravel()
    finite = numbers[np.isfinite(numbers)]
    share = f"{finite.size} of {numbers.size}"
    if not finite.size:
        return ["–", "–", "–", share]
    return [f"{number:.6g}" for number in (finite.min(), np.median(finite), finite.max())] + [share]


def to_pandas(answer: Any) -> Any:
    """Return an answer as a pandas DataFrame, a row a sample; of scores, a row a recording.

    Raises:
        ModuleNotFoundError: pandas is not installed.
        ValueError: there are more axes than time, or lanes.
    """
    try:
        import pandas  # pyright: ignore[reportMissingImports, reportMissingModuleSource]
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError("to_pandas needs pandas, which vsajax does not: pip install pandas") from error
    return pandas.DataFrame(_series(answer))


def plot(answer: Any, *, time: Any = None) -> Any:
    """Return a matplotlib figure of an answer's series; a standard deviation is a band of ± 2 about what it is of.

    Args:
        answer: with a time axis.
        time: `(time,)` [s]; by default the answer's own, else the number of the sample.

    Raises:
        ModuleNotFoundError: matplotlib is not installed.
        ValueError: there is no time axis, or an axis beside it, or `time` is of another length.
    """
    series = _series(answer)
    own = series.pop("time", None)
    time = own if time is None else np.asarray(time)
    label = "sample" if time is None else "time [s]"
    samples = max((values.size for values in series.values()), default=0)
    if samples < 2:
        raise ValueError("there is no time axis to draw over: use to_pandas, or print the numbers")
    time = np.arange(samples) if time is None else time
    if time.shape != (samples,):
        raise ValueError(f"time has the shape {time.shape}, but the answer has {samples} samples")
    try:
        from matplotlib.figure import Figure
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError("plot needs matplotlib: pip install matplotlib") from error
    names = [name for name in series if not (name.endswith("_std") and name.removesuffix("_std") in series)]
    names = names[:_SHOWN]
    figure = Figure(figsize=(7.0, 0.6 + 1.2 * len(names)), layout="constrained")
    axes = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
    for axis, name in zip(axes, names, strict=True):
        values = series[name].astype(float)
        axis.plot(time, values, linewidth=1.2)
        if (std := series.get(f"{name}_std")) is not None:
            reach = np.where(np.isfinite(std), 2.0 * std, np.nan)
            axis.fill_between(time, values - reach, values + reach, alpha=0.25, linewidth=0)
        axis.set_ylabel(name, fontsize=8)
    axes[-1].set_xlabel(label)
    return figure


def _series(answer: Any) -> dict[str, np.ndarray]:
    """Return an answer's columns, each of one axis of the same length; a number is one row, or stands in all."""
    found = columns(answer)
    for name, values in found.items():
        if values.ndim > 1:
            raise ValueError(
                f"{name} has the shape {values.shape}: choose one lane first, jax.tree.map(lambda x: x[0], answer)"
            )
    rows = max((values.size for values in found.values()), default=0)
    return {name: np.broadcast_to(np.atleast_1d(values), (rows,)) for name, values in found.items()}
