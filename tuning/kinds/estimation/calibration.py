"""The one factor on an estimator's band with which it holds the truth as often as it says."""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from tuning.kinds.estimation.problem import EstimationProblem
from tuning.kinds.estimation.study import EstimationStudy
from tuning.problem.build import with_leaves
from tuning.problem.calibration import is_band
from tuning.problem.interface import Scenario
from tuning.study.paths import numeric_paths
from vsajax.experiments import estimation

_AT_A_TIME = 16


def calibrate(study: EstimationStudy) -> dict[str, float]:
    """Return the factors of a study's fits, by path, with which its band holds the truth as often as it says.

    Of all samples of the training scenarios from the warm-up time on at which the answer is known, as many are
    then inside the band as a normal distribution has within `scorer.sigmas`. One factor serves both sides of a
    pair. What holds on these scenarios must be judged on others.

    Args:
        study: the study at the numbers to be deployed.

    Returns:
        Nothing where no sample is known, or the estimator has no such factor.
    """
    numbers = numeric_paths(study)
    paths = [path for path in numbers if is_band(path)]
    errors = known_errors(study) if paths else np.empty(0)
    if not errors.size:
        return {}
    sigmas = study.scorer.sigmas
    factor = float(np.quantile(errors, math.erf(sigmas / math.sqrt(2.0)))) / sigmas
    if not 0.0 < factor < math.inf:
        return {}
    return {path: factor * numbers[path] for path in paths}


def known_errors(study: EstimationStudy) -> np.ndarray:
    """Return |σ̂ − σ| in standard deviations at all known samples after the warm-up, of the training scenarios."""
    problem = EstimationProblem(study)
    given = problem.given

    def one(scenario: Scenario) -> Float[Array, " time"]:
        bench = with_leaves(given.bench, scenario.numbers)
        truth, recording = problem.record(scenario, given)
        answer = estimation.estimate(bench.estimator, recording)
        error = jnp.abs(answer.stiffness - truth.motion.stiffness) / answer.stiffness_std
        return jnp.where(answer.known & (recording.time >= bench.scorer.warm_up), error, jnp.nan)

    scenarios = problem.scenarios("train", study.scenarios.train)
    errors = np.asarray(jax.jit(lambda drawn: jax.lax.map(one, drawn, batch_size=_AT_A_TIME))(scenarios))
    return errors[np.isfinite(errors)]
