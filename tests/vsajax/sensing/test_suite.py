import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vsajax import Recording
from vsajax.plants import Motion
from vsajax.sensing import Encoder, Sensor, SensorSuite

TIME = jnp.arange(101) * 1e-3
MOTION = Motion(*(jnp.sin(TIME * (i + 1.0)) for i in range(len(Motion._fields))))
KEY = jax.random.key(3)


@pytest.mark.contract
def test_recording_has_exactly_the_signals_with_a_sensor():
    recording = SensorSuite(link_position=Sensor(), motor_torque=Sensor(bias=0.5)).measure(TIME, MOTION, key=KEY)
    assert recording.present() == {"time", "link_position", "motor_torque"}
    np.testing.assert_array_equal(recording.time, TIME)
    np.testing.assert_array_equal(recording.link_position, MOTION.link_position)
    np.testing.assert_array_equal(recording.motor_torque, MOTION.motor_torque + 0.5)


@pytest.mark.contract
def test_suite_has_a_place_for_every_signal_of_a_recording():
    assert tuple(SensorSuite.__dataclass_fields__) == Recording._fields[1:]


@pytest.mark.contract
def test_noise_of_a_signal_does_not_depend_on_the_other_sensors():
    noisy = Sensor(noise_std=0.1)
    alone = SensorSuite(motor_torque=noisy).measure(TIME, MOTION, key=KEY)
    among = SensorSuite(
        link_position=noisy, motor_position=Sensor(), elastic_torque=noisy, deflection=noisy, motor_torque=noisy
    ).measure(TIME, MOTION, key=KEY)
    np.testing.assert_array_equal(alone.motor_torque, among.motor_torque)
    assert np.any(among.motor_torque - MOTION.motor_torque != among.elastic_torque - MOTION.elastic_torque)


@pytest.mark.structure
def test_signals_without_noise_are_not_repeated_for_every_noise_draw():
    suite = SensorSuite(
        link_position=Sensor(encoder=Encoder(40000.0)), elastic_torque=Sensor(noise_std=0.1), motor_torque=Sensor()
    )
    keys = jax.random.split(KEY, 5)
    batched = jax.make_jaxpr(jax.vmap(lambda k: suite.measure(TIME, MOTION, key=k), out_axes=0))(keys)
    # Outputs must have the axis; the noiseless ones get it by a broadcast, nothing else of theirs is batched.
    widths = [eqn.primitive.name for eqn in batched.eqns if any(v.aval.shape == (5, 101) for v in eqn.outvars)]
    assert "round" not in widths
    assert "div" not in widths
    one = suite.measure(TIME, MOTION, key=KEY)
    batch_axes = one._replace(time=None, link_position=None, elastic_torque=0, motor_torque=None)
    recordings = jax.vmap(lambda k: suite.measure(TIME, MOTION, key=k), out_axes=batch_axes)(keys)
    # vmap would refuse an output axis of None for a batched signal.
    assert recordings.elastic_torque.shape == (5, 101)
    assert recordings.link_position.shape == (101,)
