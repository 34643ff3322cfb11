import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.vsajax.builders import paper_basis, paper_estimator, paper_recording, residual_torque
from vsajax import Bench, Scorer, plants
from vsajax.experiments import estimation
from vsajax.plants import awas
from vsajax.sensing import Clock, Encoder, Excitation, Sensor, SensorSuite, Sine

KEY = jax.random.key(11)


def bench(**changes) -> Bench:
    parts = {
        "joint": awas(),
        "excitation": Excitation(motor=Sine(0.3, 0.1), setpoint_motor=Sine(8.0, 0.1)),
        "sensing": SensorSuite(
            link_position=Sensor(encoder=Encoder(40000.0)),
            motor_position=Sensor(encoder=Encoder(40000.0)),
            setpoint_position=Sensor(encoder=Encoder(1024.0)),
            motor_torque=Sensor(noise_std=0.0032),
        ),
        "estimator": paper_estimator(residual_torque(), basis=paper_basis(2, 1)),
        "scorer": Scorer(warm_up=0.1),
        "clock": Clock(sample_time=1e-3, duration=0.25),
    }
    return Bench(**(parts | changes))


@jax.jit
def pipeline(lab: Bench, key: jax.Array):
    truth_key, noise_key = jax.random.split(key)
    truth = estimation.simulate(lab, key=truth_key, substeps=1)
    recording = estimation.measure(lab, truth, key=noise_key)
    return estimation.score(lab.estimator, recording, truth.motion.stiffness, scorer=lab.scorer)


def assert_same(left, right, relative=1e-9):
    # Sums of 251 squares of regressions whose rounding is 1e-12; batching may fuse them otherwise.
    for a, b in zip(jax.tree.leaves(left), jax.tree.leaves(right), strict=True):
        np.testing.assert_allclose(a, b, rtol=relative, atol=relative)


def stack(trees):
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *trees)


@pytest.mark.oracle
def test_simulation_is_that_of_radau(golden):
    # The bench knows the torques between samples: no hold. Four steps a millisecond leave 2.3e-8 rad of the link,
    # 5e-8 rad of the set-point motor, whose velocity lags by half a step.
    lab = bench(clock=Clock(sample_time=1e-3, duration=2.0))
    truth = jax.jit(lambda b: estimation.simulate(b, key=KEY, substeps=4))(lab)
    np.testing.assert_allclose(truth.time, np.arange(2001) * 1e-3, rtol=1e-14)
    np.testing.assert_allclose(truth.motion.motor_torque, golden["tau"], atol=1e-15)
    np.testing.assert_allclose(truth.motion.link_position, golden["q"], rtol=0.0, atol=3e-8)
    np.testing.assert_allclose(truth.motion.setpoint_position, golden["theta_c"], rtol=0.0, atol=6e-8)
    np.testing.assert_allclose(truth.motion.stiffness, golden["sigma"], rtol=1e-9)


@pytest.mark.equivalence
def test_simulation_on_a_jittered_clock_follows_the_regular_one():
    still = bench(clock=Clock(sample_time=1e-3, duration=0.25))
    jittered = bench(clock=Clock(sample_time=1e-3, duration=0.25, jitter_std=2e-4))
    run = jax.jit(lambda b: estimation.simulate(b, key=KEY, substeps=2))
    regular, irregular = run(still), run(jittered)
    assert np.max(np.abs(irregular.time - regular.time)) > 3e-4
    # The motion is smooth on a millisecond: a cubic through the regular samples shows the irregular ones.
    from scipy.interpolate import CubicSpline

    for name in ("link_position", "motor_position", "stiffness"):
        expected = CubicSpline(regular.time, getattr(regular.motion, name))(irregular.time[:-1])
        ours = getattr(irregular.motion, name)[:-1]
        np.testing.assert_allclose(ours, expected, rtol=0.0, atol=1e-5 * np.max(np.abs(expected)), err_msg=name)


@pytest.mark.equivalence
def test_score_is_the_score_of_the_estimate(golden):
    recording = paper_recording(golden, "residual", 300)
    stiffness = jnp.asarray(golden["sigma"][:300])
    estimator, scorer = bench().estimator, Scorer(warm_up=0.1)
    answer = jax.jit(estimation.estimate)(estimator, recording)
    direct = jax.jit(lambda e: estimation.score(e, recording, stiffness, scorer=scorer))(estimator)
    assert_same(direct, estimation.score_estimate(recording.time, stiffness, answer, scorer=scorer), 1e-12)


@pytest.mark.equivalence
@pytest.mark.parametrize("segment", [1, 13, 300, 1000])
def test_segments_do_not_change_the_estimate(golden, segment):
    recording = paper_recording(golden, "residual", 300)
    run = jax.jit(estimation.estimate, static_argnames="segment")
    whole, cut = run(bench().estimator, recording), run(bench().estimator, recording, segment=segment)
    full = np.max(np.abs(whole.stiffness))
    np.testing.assert_allclose(cut.stiffness, whole.stiffness, rtol=0.0, atol=1e-11 * full)


@pytest.mark.equivalence
def test_population_is_a_loop_over_joints_sensors_and_noise():
    labs = [
        eqx.tree_at(
            lambda b: (b.joint.spring.spring_rate, b.sensing.motor_torque.noise_std),
            bench(),
            (jnp.asarray(rate), jnp.asarray(noise)),
        )
        for rate, noise in ((1.2e4, 0.001), (1.4e4, 0.003), (1.6e4, 0.01))
    ]
    keys = jax.random.split(KEY, 3)
    together = jax.vmap(pipeline)(stack(labs), keys)
    alone = stack([pipeline(lab, key) for lab, key in zip(labs, keys, strict=True)])
    assert_same(together, alone)
    assert len(set(map(float, together.msrep))) == 3


@pytest.mark.equivalence
def test_nested_grid_is_two_loops(golden):
    recording = paper_recording(golden, "residual", 200)
    stiffness = jnp.asarray(golden["sigma"][:200])
    gains, priors = jnp.asarray([50.0, 300.0, 900.0]), jnp.asarray([0.1, 10.0])

    def msrep(gain, prior):
        estimator = eqx.tree_at(
            lambda e: (e.torque.observer_gain, e.fit.prior_scale), bench().estimator, (gain, prior)
        )
        return estimation.score(estimator, recording, stiffness, scorer=Scorer()).msrep

    grid = jax.jit(jax.vmap(jax.vmap(msrep, (0, None)), (None, 0)))(gains, priors)
    one = jax.jit(msrep)
    assert_same(grid, jnp.asarray([[one(gain, prior) for gain in gains] for prior in priors]))


@pytest.mark.contract
def test_truth_and_recording_share_the_clock():
    lab = bench(clock=Clock(sample_time=1e-3, duration=0.05, jitter_std=1e-4))
    truth = estimation.simulate(lab, key=KEY, substeps=1)
    recording = estimation.measure(lab, truth, key=KEY)
    np.testing.assert_array_equal(recording.time, truth.time)
    assert recording.present() == {"time", *lab.estimator.needs, "setpoint_position"}
    assert isinstance(truth.motion, plants.Motion)
