"""The nouns that every part of the library shares: samples in, estimates out."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from vsajax import showing

Scalar = Float[Array, ""]
RunningSum = Scalar
"""A sum over all samples so far. It outgrows single precision, so that generated code keeps it in double."""
Series = Float[Array, " time"]


class PrecisionError(TypeError):
    """A computation that is unsafe in single precision was asked for in single precision."""


def as_leaf(value: object) -> Array:
    """Return `value` as a strongly typed float array, so that all values of a tunable share one trace.

    The converter of every tunable number of a module.
    """
    return jnp.asarray(value, jnp.result_type(float))


def optional_leaf(value: object) -> Array | None:
    """Like `as_leaf`; `None`, a feature that is absent from the compiled program, stays `None`."""
    return None if value is None else as_leaf(value)


def require_float64(what: str) -> None:
    """Raise `PrecisionError` unless double precision is switched on."""
    if not jax.config.jax_enable_x64:
        raise PrecisionError(
            f"{what} needs float64: squared deflections lie below single precision. "
            "Call jax.config.update('jax_enable_x64', True) at the start of the program "
            "(the command line does)."
        )


class MissingSignalError(ValueError):
    """A recording lacks a signal that an estimator needs."""


class Sample(NamedTuple):
    """What a joint's sensors say at one instant; a signal that is not measured is `None`.

    Args:
        dt: time since the previous sample [s]; 0 for the first.
        link_position: [rad].
        motor_position: principal motor, on the joint side of the gear [rad].
        setpoint_position: stiffness-setting motor, on the joint side of its gear [rad].
        motor_torque: principal motor, on the motor axis [N·m].
        elastic_torque: joint torque sensor [N·m].
        deflection: link minus motor position, where it is measured by itself [rad].
        motor1_position: first motor of an antagonistic pair [rad].
        motor2_position: second motor [rad].
        motor1_torque: [N·m].
        motor2_torque: [N·m].
    """

    dt: Scalar
    link_position: Scalar | None = None
    motor_position: Scalar | None = None
    setpoint_position: Scalar | None = None
    motor_torque: Scalar | None = None
    elastic_torque: Scalar | None = None
    deflection: Scalar | None = None
    motor1_position: Scalar | None = None
    motor2_position: Scalar | None = None
    motor1_torque: Scalar | None = None
    motor2_torque: Scalar | None = None

    def side(self, number: int) -> Sample:
        """Return what one transmission of an antagonistic pair sees; `number` is 1 or 2."""
        return Sample(
            self.dt,
            self.link_position,
            motor_position=getattr(self, f"motor{number}_position"),
            motor_torque=getattr(self, f"motor{number}_torque"),
        )

    def read(self, name: str) -> Scalar:
        """Return a signal.

        Raises:
            MissingSignalError: it was not measured.
        """
        value = getattr(self, name)
        if value is None:
            present = sorted(n for n, v in self._asdict().items() if v is not None and n != "dt")
            raise MissingSignalError(
                f"the estimator needs the signal {name}, which the recording lacks; it has "
                f"{', '.join(present)}. Record it, or choose another torque source, deflection or basis."
            )
        return value


class Recording(NamedTuple):
    """The signals of a `Sample` over time; `time` is strictly increasing and may be irregular [s]."""

    time: Series
    link_position: Series | None = None
    motor_position: Series | None = None
    setpoint_position: Series | None = None
    motor_torque: Series | None = None
    elastic_torque: Series | None = None
    deflection: Series | None = None
    motor1_position: Series | None = None
    motor2_position: Series | None = None
    motor1_torque: Series | None = None
    motor2_torque: Series | None = None

    def samples(self) -> Sample:
        """Return the recording as a `Sample` whose leaves have a leading time axis."""
        dt = jnp.diff(self.time, prepend=self.time[:1])
        return Sample(dt, *self[1:])

    def present(self) -> frozenset[str]:
        """Return the names of the signals that are not `None`."""
        return frozenset(name for name, value in self._asdict().items() if value is not None)

    _repr_html_ = showing.to_html
    to_pandas = showing.to_pandas
    plot = showing.plot


class Signals(NamedTuple):
    """What an estimator worked with at one instant, for plots and diagnosis.

    Args:
        deflection: as used in the regressors [rad].
        torque: the elastic torque fed to the fit [N·m].
        motor_velocity: [rad/s]; 0 where no velocity filter runs.
        stability_factor: a(k) of the recursive fit, dimensionless.
        determined: how many of the coefficients the data determine rather than the prior, the effective
            degrees of freedom of the fit.
    """

    deflection: Float[Array, "..."]
    torque: Float[Array, "..."]
    motor_velocity: Float[Array, "..."]
    stability_factor: Float[Array, "..."]
    determined: Float[Array, "..."]


class Estimate(NamedTuple):
    """An estimator's answer at one instant (or, with a leading time axis, over a recording).

    Args:
        stiffness: [N·m/rad].
        stiffness_std: posterior standard deviation [N·m/rad].
        elastic_torque: torque of the fitted characteristic at the present deflection [N·m].
        known: whether the excitation so far is enough to believe the stiffness.
        signals: the signals behind the answer.
        sides: of an antagonistic pair, the estimates of its two transmissions; their stiffnesses add up.
        held: whether this sample was left out and the last answer is given again, see `vsajax.guard`; `None` of a
            bare step, which leaves no sample out.
        skipped: how many samples were left out so far.
    """

    stiffness: Float[Array, "..."]
    stiffness_std: Float[Array, "..."]
    elastic_torque: Float[Array, "..."]
    known: Bool[Array, "..."]
    signals: Signals
    sides: tuple[Estimate, ...] = ()
    held: Bool[Array, "..."] | None = None
    skipped: Int[Array, "..."] | None = None

    _repr_html_ = showing.to_html
    to_pandas = showing.to_pandas
    plot = showing.plot


class Swing(NamedTuple):
    """How a joint moves about its rest, as a controller sees it at one instant.

    Args:
        dt: time since the previous instant [s]; 0 for the first.
        position: of the link, q, 0 where it should come to rest [rad].
        velocity: of the link [rad/s].
        acceleration: of the link [rad/s²].
        motor_position: θ, to which the spring pulls the link [rad].
    """

    dt: Float[Array, "..."]
    position: Float[Array, "..."]
    velocity: Float[Array, "..."]
    acceleration: Float[Array, "..."]
    motor_position: Float[Array, "..."]

    @property
    def deflection(self) -> Float[Array, "..."]:
        """Of the spring, q − θ [rad]."""
        return self.position - self.motor_position


class Command(NamedTuple):
    """What a controller asks of a joint's actuators.

    Args:
        stiffness: [N·m/rad].
        motor_position: θ [rad].
        held: whether this sample was left out and the last command is given again, see `vsajax.guard`; `None` of a
            bare step, which leaves no sample out.
        skipped: how many samples were left out so far.
    """

    stiffness: Float[Array, "..."]
    motor_position: Float[Array, "..."]
    held: Bool[Array, "..."] | None = None
    skipped: Int[Array, "..."] | None = None
