import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import TypeCheckError

from vsajax import PrecisionError, Recording, Sample
from vsajax.plants import LinearSpring
from vsajax.types import MissingSignalError, as_leaf, optional_leaf, require_float64


@pytest.mark.contract
@pytest.mark.parametrize("value", [1, 1.0, np.float32(1.0), np.int64(1), True, jnp.asarray(1.0)], ids=repr)
def test_leaves_of_any_origin_share_one_type(value):
    # A weak type or another width would be another trace, and so a recompilation.
    leaf = as_leaf(value)
    assert (leaf.dtype, leaf.weak_type, leaf.shape) == (jnp.float64, False, ())
    assert float(leaf) == 1.0


@pytest.mark.contract
def test_absent_leaf_stays_absent():
    assert optional_leaf(None) is None
    assert optional_leaf(2) == 2.0


@pytest.mark.failure
def test_single_precision_is_refused_by_name():
    require_float64("this")
    with jax.enable_x64(False), pytest.raises(PrecisionError, match="this needs float64"):
        require_float64("this")


@pytest.mark.contract
def test_errors_derive_from_what_callers_expect():
    assert issubclass(PrecisionError, TypeError)
    assert issubclass(MissingSignalError, ValueError)


@pytest.mark.contract
def test_samples_carry_their_own_interval():
    time = jnp.asarray([2.0, 2.5, 2.75, 4.0])
    samples = Recording(time, link_position=time**2).samples()
    np.testing.assert_array_equal(samples.dt, [0.0, 0.5, 0.25, 1.25])
    np.testing.assert_array_equal(samples.link_position, time**2)
    assert samples.motor_torque is None


@pytest.mark.contract
def test_samples_and_recordings_name_the_same_signals():
    assert Sample._fields[1:] == Recording._fields[1:]


@pytest.mark.contract
def test_recording_knows_which_signals_it_has():
    recording = Recording(jnp.zeros(2), deflection=jnp.zeros(2))
    assert recording.present() == {"time", "deflection"}


@pytest.mark.failure
def test_reading_an_absent_signal_names_it_and_those_present():
    sample = Sample(jnp.asarray(0.0), deflection=jnp.asarray(0.1))
    assert sample.read("deflection") == 0.1
    with pytest.raises(MissingSignalError, match=r"signal motor_torque, .* it has deflection\."):
        sample.read("motor_torque")


@pytest.mark.structure
def test_annotations_are_checked_at_run_time_under_test():
    # The import hook of tests/conftest.py is on: shapes in annotations are promises.
    # (Fields with a converter are not checked: their annotation is the converter's.)
    with pytest.raises(TypeCheckError):
        require_float64(5)
    with pytest.raises(TypeCheckError):
        LinearSpring(1.0).torque(jnp.asarray(0.0), jnp.asarray(1))
