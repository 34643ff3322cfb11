"""One number for many scenarios: their mean, a quantile, or the mean of the worst (CVaR).

Each is a weighted sum of the scenarios' sorted scores, so that minimising it by least squares means weighting the
scenarios' residuals, and its gradient is that of the weighted sum.
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from tuning.files.toml import Table

Kind = Literal["mean", "quantile", "cvar"]


class Statistic(Table):
    """How a search sums up the scenarios.

    Args:
        kind: "mean"; "quantile", the score that a share `level` of the scenarios stays below, interpolated
            linearly; or "cvar", the mean of the worst 1 − `level` of them.
        level: 0 < level < 1; unused by "mean".
    """

    kind: Kind = "mean"
    level: Annotated[float, Field(gt=0, lt=1)] = 0.95

    @property
    def label(self) -> str:
        """Its name for people."""
        if self.kind == "mean":
            return "mean"
        return f"{100 * self.level:g} % quantile" if self.kind == "quantile" else f"CVaR {100 * self.level:g} %"

    def ranked_weights(self, count: int) -> np.ndarray:
        """Return the weights of `count` scores in ascending order; they sum to 1."""
        if self.kind == "mean":
            return np.full(count, 1.0 / count)
        if self.kind == "quantile":
            place = (count - 1) * self.level
            return np.maximum(0.0, 1.0 - np.abs(np.arange(count) - place))
        worst = count * (1.0 - self.level)
        # The last scenario inside the tail counts in part where the tail is no whole number of them.
        return np.clip(np.arange(count) + 1 - (count - worst), 0.0, 1.0) / worst

    def of(self, scores: np.ndarray, axis: int = -1) -> np.ndarray:
        """Return the statistic along an axis; NaN where a scenario that counts has no score."""
        ordered = np.moveaxis(np.sort(scores, axis=axis), axis, -1)
        weights = self.ranked_weights(ordered.shape[-1])
        return np.where(weights > 0, ordered * weights, 0.0).sum(axis=-1)
