import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.oracles import least_squares, residual
from tests.oracles.basis import separable
from tests.oracles.kalman import mkkf
from tests.vsajax.builders import PITCH, paper_basis, paper_estimator, paper_recording, residual_torque
from vsajax import Estimate, MissingSignalError, PrecisionError, Recording
from vsajax.estimators import (
    EnhancedFactor,
    FiniteDifference,
    ModelTorque,
    RecursiveLeastSquares,
    SensorTorque,
    StiffnessEstimator,
)
from vsajax.experiments import estimation
from vsajax.plants import LeverSpring

ALL = {"model": SensorTorque(), "sensor": SensorTorque(), "residual": residual_torque()}


@jax.jit
def estimate(estimator: StiffnessEstimator, recording: Recording) -> Estimate:
    return estimation.estimate(estimator, recording)


def assert_full_scale(ours, theirs, relative):
    np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=relative * np.max(np.abs(theirs)))


@pytest.mark.oracle
def test_estimates_are_those_of_the_reference(reference):
    for source, torque in ALL.items():
        answer = estimate(paper_estimator(torque), paper_recording(reference, source))
        # Measured: filters 1e-14 of full scale; stiffness, after a regression of condition 1e12, 3e-13.
        assert_full_scale(answer.signals.deflection, reference["phi_hat"], 1e-9)
        assert_full_scale(answer.signals.motor_velocity, reference["dtheta_hat"], 1e-9)
        if source == "residual":
            assert_full_scale(answer.signals.torque, reference["torque_residual"], 1e-9)
        assert_full_scale(answer.stiffness, reference[f"sigma_{source}"], 1e-7)
        assert_full_scale(answer.elastic_torque, reference[f"fit_{source}"], 1e-7)


@pytest.mark.oracle
def test_stability_factor_is_that_of_the_reference(golden):
    # a(k) depends on deflection and set-point alone, so it is the same for every source of torque.
    fit = RecursiveLeastSquares(1e20, EnhancedFactor(1e-20))
    answer = estimate(paper_estimator(SensorTorque(), fit=fit), paper_recording(golden, "sensor"))
    for source in ALL:
        np.testing.assert_allclose(answer.signals.stability_factor, golden[f"a_{source}"], rtol=1e-7)


@pytest.mark.oracle
def test_whole_pipeline_matches_its_numpy_twin(golden):
    recording = paper_recording(golden, "residual")
    dt = np.diff(recording.time, prepend=recording.time[0])
    link, _ = mkkf(np.asarray(recording.link_position), dt)
    motor, velocity = mkkf(np.asarray(recording.motor_position), dt)
    torque = residual.elastic_torque(
        np.asarray(recording.motor_torque),
        motor,
        velocity,
        dt,
        gain=300.0,
        inertia=2.3e-5,
        damping=0.001,
        gear_ratio=50.0,
    )
    features, slopes = separable(link - motor, 1000.0 * (0.1 + PITCH * np.asarray(recording.setpoint_position)))
    coefficients, _ = least_squares.plain(features, torque, 1.0)
    answer = estimate(paper_estimator(residual_torque()), recording)
    assert_full_scale(answer.stiffness, np.sum(slopes * coefficients, axis=1), 1e-10)


@pytest.mark.analytic
def test_raw_and_measured_deflections_are_taken_as_they_are(golden):
    recording = paper_recording(golden, "sensor", 200)
    raw = estimate(paper_estimator(basis=paper_basis(2, 1), deflection="raw"), recording)
    expected = recording.link_position - recording.motor_position
    np.testing.assert_array_equal(raw.signals.deflection, expected)
    measured = Recording(recording.time, elastic_torque=recording.elastic_torque, deflection=expected)
    answer = estimate(paper_estimator(basis=paper_basis(2, 1), deflection="measured"), measured)
    np.testing.assert_array_equal(answer.stiffness, raw.stiffness)


@pytest.mark.analytic
def test_model_torque_knows_the_setpoint_even_when_the_basis_does_not(golden):
    # A nominal law needs its set-point whatever the regression is on; without it the lever arm would be r₀.
    law = LeverSpring(spring_rate=14220.0, arm=0.1, pitch=PITCH)
    estimator = paper_estimator(ModelTorque(law), basis=paper_basis(2, 1), deflection="raw")
    recording = paper_recording(golden, "sensor", 200)
    answer = estimate(estimator, recording)
    expected = law.torque(recording.setpoint_position, recording.link_position - recording.motor_position)
    assert_full_scale(answer.signals.torque, expected, 1e-13)


@pytest.mark.contract
@pytest.mark.parametrize("deflection", ["filtered", "raw", "measured"])
@pytest.mark.parametrize("source", ALL)
@pytest.mark.parametrize("setpoint_terms", [1, 3])
def test_needs_are_exactly_what_a_recording_must_have(golden, deflection, source, setpoint_terms):
    estimator = paper_estimator(ALL[source], basis=paper_basis(2, setpoint_terms), deflection=deflection)
    signals = paper_recording(golden, "residual", 4)._replace(elastic_torque=jnp.zeros(4), deflection=jnp.zeros(4))
    unneeded = {name: None for name in signals._fields if name not in {"time", *estimator.needs}}
    sufficient = signals._replace(**unneeded)
    assert jax.eval_shape(estimation.estimate, estimator, sufficient).stiffness.shape == (4,)
    for name in estimator.needs:
        with pytest.raises(MissingSignalError, match=rf"needs the signal {name}, which the recording lacks"):
            jax.eval_shape(estimation.estimate, estimator, sufficient._replace(**{name: None}))


@pytest.mark.failure
def test_missing_signal_says_what_is_there_and_the_way_out(golden):
    recording = paper_recording(golden, "residual", 4)
    message = (
        r"the estimator needs the signal elastic_torque, which the recording lacks; it has link_position, "
        r"motor_position, motor_torque, setpoint_position\. Record it, or choose another torque source, "
        r"deflection or basis\."
    )
    with pytest.raises(MissingSignalError, match=message):
        estimation.estimate(paper_estimator(SensorTorque()), recording)


@pytest.mark.failure
def test_single_precision_is_refused_with_the_way_out(golden):
    signals = {name: value.astype(np.float32) for name, value in golden.items()}
    message = r"recursive least squares needs float64.*jax\.config\.update\('jax_enable_x64', True\)"
    with jax.enable_x64(False):
        recording, estimator = paper_recording(signals, "sensor", 4), paper_estimator()
        with pytest.raises(PrecisionError, match=message):
            estimation.estimate(estimator, recording)


@pytest.mark.equivalence
def test_velocity_filter_is_not_run_where_nobody_reads_it(golden):
    recording = paper_recording(golden, "sensor", 50)
    estimators = [
        paper_estimator(basis=paper_basis(2, 1), deflection="raw", velocity=velocity)
        for velocity in (FiniteDifference(), paper_estimator().velocity)
    ]
    answers = [estimate(estimator, recording) for estimator in estimators]
    np.testing.assert_array_equal(answers[0].stiffness, answers[1].stiffness)
    for answer in answers:
        np.testing.assert_array_equal(answer.signals.motor_velocity, 0.0)
