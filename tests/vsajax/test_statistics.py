"""Is the band that an estimate states the band in which the truth lies? A linear joint with white torque noise."""

import jax
import numpy as np
import pytest

from vsajax import Bench, Scorer
from vsajax.estimators import (
    ExcitationGate,
    RecursiveLeastSquares,
    SensorTorque,
    SeparableOddPolynomial,
    StiffnessEstimator,
)
from vsajax.experiments import estimation
from vsajax.plants import FlexibleJoint, LinearSpring, Link, Motor
from vsajax.sensing import Clock, Excitation, Sensor, SensorSuite, Sine

pytestmark = pytest.mark.statistical

SEEDS = 256
STIFFNESS = 100.0
# The share of SEEDS draws that a 95 % band holds has this standard error; gates are at four of them.
STANDARD_ERROR = np.sqrt(0.95 * 0.05 / SEEDS)


@pytest.fixture(scope="module", params=["spring alone", "with torque bias"])
def draws(request):
    """Estimates and scores of SEEDS noise draws over one motion: 3.7 N·m of elastic torque, 0.5 N·m of noise."""
    estimator = StiffnessEstimator(
        SensorTorque(),
        SeparableOddPolynomial(0.05, torque_bias=request.param == "with torque bias"),
        RecursiveLeastSquares(1e8),
        gate=ExcitationGate(max_relative_std=0.1),
        deflection="measured",
    )
    lab = Bench(
        joint=FlexibleJoint(Link(0.1, 1.0), Motor(2.3e-5, 1e-3, gear_ratio=50.0), LinearSpring(STIFFNESS)),
        excitation=Excitation(external=Sine(5.0, 3.0)),
        sensing=SensorSuite(elastic_torque=Sensor(noise_std=0.5), deflection=Sensor()),
        estimator=estimator,
        scorer=Scorer(),
        clock=Clock(sample_time=1e-3, duration=0.5),
    )

    @jax.jit
    def run(keys):
        truth = estimation.simulate(lab, key=jax.random.key(0), substeps=1)

        def one(key):
            recording = estimation.measure(lab, truth, key=key)
            answer = estimation.estimate(lab.estimator, recording)
            scores = estimation.score_estimate(truth.time, truth.motion.stiffness, answer, scorer=lab.scorer)
            return answer, scores

        return jax.vmap(one)(keys)

    return jax.tree.map(np.asarray, run(jax.random.split(jax.random.key(1), SEEDS)))


def share_within(errors, stds) -> float:
    return float(np.mean(np.abs(errors) <= 1.959963984540054 * stds))


@pytest.mark.parametrize("sample", [100, 200, 500])
def test_95_percent_band_holds_the_truth_95_percent_of_the_time(draws, sample):
    answer, _ = draws
    share = share_within(answer.stiffness[:, sample] - STIFFNESS, answer.stiffness_std[:, sample])
    assert abs(share - 0.95) < 4 * STANDARD_ERROR


def test_stated_deviation_is_the_actual_one(draws):
    answer, _ = draws
    actual = np.std(answer.stiffness[:, -1])
    # A standard deviation of SEEDS draws errs by 1/√(2·SEEDS) = 4.4 %. The averages of five samples leave 2·500/9
    # degrees of freedom: the mean of a deviation of Student's distribution is 0.7 % above its scale.
    ratio = np.mean(answer.stiffness_std[:, -1]) / actual
    assert abs(ratio - 1.007) < 4 / np.sqrt(2 * SEEDS)


def test_estimate_is_unbiased(draws):
    answer, _ = draws
    final = answer.stiffness[:, -1]
    assert abs(np.mean(final) - STIFFNESS) < 4 * np.std(final) / np.sqrt(SEEDS)


def test_known_answers_deserve_it_from_the_first_on(draws):
    answer, _ = draws
    first = np.argmax(answer.known, axis=1)
    lanes = np.arange(SEEDS)
    assert np.all(answer.known[lanes, first])
    # Neither at once nor only at the end.
    assert 10 < np.mean(first) < 200
    errors, stds = answer.stiffness[lanes, first] - STIFFNESS, answer.stiffness_std[lanes, first]
    assert abs(share_within(errors, stds) - 0.95) < 4 * STANDARD_ERROR
    # With some fifty samples behind the deviation, one draw of SEEDS in a hundred strays further than this.
    assert np.max(np.abs(errors) / stds) < 4.5


def test_score_reports_that_coverage(draws):
    _, scores = draws
    # Coverage is correlated within a recording, not between them: the draws give its standard error.
    error = np.std(scores.coverage) / np.sqrt(SEEDS)
    assert abs(np.mean(scores.coverage) - 0.95) < 4 * error
    assert np.all(scores.known_share > 0.5)
