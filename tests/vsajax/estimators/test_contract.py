import inspect

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.vsajax.estimators.registry import ESTIMATORS, full_recording
from vsajax import MissingSignalError, estimators
from vsajax.experiments import estimation

pytestmark = pytest.mark.contract

VARIANTS = {"algebraic from rest", "matched", "unequal pair", "kalman"}
"""Of estimators that are there in another form."""
each_estimator = pytest.mark.parametrize("estimator", ESTIMATORS.values(), ids=ESTIMATORS.keys())


def test_registry_holds_every_estimator():
    classes = {cls for _, cls in inspect.getmembers(estimators, inspect.isclass)}
    all_of_them = {cls for cls in classes if issubclass(cls, estimators.AbstractEstimator)}
    assert {type(e) for e in ESTIMATORS.values()} == all_of_them - {estimators.AbstractEstimator}


@pytest.mark.parametrize(
    "estimator",
    [
        pytest.param(e, id=name, marks=[pytest.mark.slow] if name in VARIANTS else [])
        for name, e in ESTIMATORS.items()
    ],
)
def test_online_is_offline(estimator):
    # What runs on a robot, one sample after the other, is what was tuned on recordings.
    recording = full_recording()
    offline = jax.jit(estimation.estimate)(estimator, recording)
    samples, step = recording.samples(), jax.jit(lambda e, s, x: e.step(s, x))
    state, online = estimator.init(jax.tree.map(lambda x: x[0], samples)), []
    for k in range(len(recording.time)):
        state, answer = step(estimator, state, jax.tree.map(lambda x, k=k: x[k], samples))
        online.append(answer)
    online = jax.tree.map(lambda *x: np.stack(x), *online)
    # The convolution of the algebraic observer rounds relative to its largest output; regressions magnify by 1e3.
    for name in ("stiffness", "elastic_torque"):
        ours, theirs = getattr(online, name), getattr(offline, name)
        np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=1e-9 * np.max(np.abs(theirs)), err_msg=name)
    # The deviation is the root of a sum of squares that starts at rounding errors.
    np.testing.assert_allclose(online.stiffness_std[30:], offline.stiffness_std[30:], rtol=1e-6)
    assert np.mean(online.known == offline.known) > 0.98


@each_estimator
def test_state_keeps_its_structure(estimator):
    # A scan needs the carry to come back as it went in: shapes, dtypes, no weak types.
    sample = jax.tree.map(lambda x: x[0], full_recording().samples())
    before = estimator.init(sample)
    after, answer = estimator.step(before, sample)
    signature = lambda tree: jax.tree.map(lambda x: (jnp.shape(x), jnp.result_type(x)), tree)  # noqa: E731
    assert signature(before) == signature(after)
    for field in ("stiffness", "stiffness_std", "elastic_torque", "known"):
        assert jnp.shape(getattr(answer, field)) == ()


@each_estimator
def test_needs_suffice_and_each_is_missed(estimator):
    recording = full_recording(4)
    unneeded = {name: None for name in recording._fields if name not in {"time", *estimator.needs}}
    sufficient = recording._replace(**unneeded)
    assert jax.eval_shape(estimation.estimate, estimator, sufficient).stiffness.shape == (4,)
    for name in estimator.needs:
        with pytest.raises(MissingSignalError):
            jax.eval_shape(estimation.estimate, estimator, sufficient._replace(**{name: None}))


@each_estimator
def test_answers_are_finite_and_uncertainty_is_not_negative(estimator):
    answer = jax.jit(estimation.estimate)(estimator, full_recording())
    assert np.all(np.isfinite(answer.stiffness))
    assert np.all(answer.stiffness_std >= 0.0)
    assert not answer.known[0]
