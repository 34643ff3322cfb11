"""What a part of each slot is tried on, and what else is asked of it there."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from tuning.study.parts.base import Part
from tuning.study.parts.rig import Sensing
from vsajax import Command, Recording, Sample, Swing, control, estimators, plants, sensing
from vsajax.estimators import Kinematics
from vsajax.experiments import estimation
from vsajax.plants import Torques

_DEFLECTIONS = jnp.linspace(-0.2, 0.2, 9)
_SETPOINTS = jnp.asarray([-0.1, 0.0, 0.2])
_TIME = np.arange(60) * 1e-3
_WAVES = {
    name: jnp.asarray(0.05 * np.sin((30.0 + 7.0 * i) * _TIME + 0.3 * i))
    for i, name in enumerate(Recording._fields[1:])
}
"""Every signal is another smooth wave, deflections of a few hundredths of a radian."""
_PHASE = 40.0 * _TIME + 0.4
_SWING = Swing(
    jnp.full(_TIME.shape, 1e-3),
    jnp.asarray(0.3 * np.cos(_PHASE)),
    jnp.asarray(-0.3 * 40.0 * np.sin(_PHASE)),
    jnp.asarray(-0.3 * 1600.0 * np.cos(_PHASE)),
    jnp.zeros(_TIME.shape),
)
"""Half a turn of a swing. It does not begin at its peak: there a switch has no slope."""


class Probe(NamedTuple):
    """How the parts of a slot are tried.

    Args:
        base: what they build.
        run: called with one, it returns what it computes on the slot's inputs: numbers of any shape.
        check: called with a table and what it builds, it raises an `AssertionError` for what else does not hold.
        may_draw: whether random numbers and the like are allowed, as they are where nothing is exported.
    """

    base: type
    run: Callable[[Any], Any]
    check: Callable[[Any, Any], None] = lambda _table, _built: None
    may_draw: bool = False


def _over_grid(function: Callable[[Any, Any], Any]) -> Any:
    return jax.vmap(lambda s: jax.vmap(lambda d: function(s, d))(_DEFLECTIONS))(_SETPOINTS)


def _law_of(spring: Any) -> Any:
    laws = (spring.torque, spring.stiffness, spring.coupling)
    return [_over_grid(law) for law in laws]


def _check_spring(table: Part, spring: Any) -> None:
    name = type(table).__name__
    _close(
        f"{name}: stiffness is not the slope of torque over deflection",
        _over_grid(spring.stiffness),
        _over_grid(jax.grad(spring.torque, argnums=1)),
    )
    # Gauss–Legendre integrates smooth laws to rounding.
    nodes, weights = map(jnp.asarray, np.polynomial.legendre.leggauss(40))

    def energy(setpoint: Any, deflection: Any) -> Any:
        torques = jax.vmap(lambda x: spring.torque(setpoint, 0.5 * deflection * (1.0 + x)))(nodes)
        return 0.5 * deflection * jnp.sum(weights * torques)

    _close(
        f"{name}: coupling is not the slope of the energy over the setpoint",
        _over_grid(spring.coupling),
        _over_grid(jax.grad(energy, argnums=0)),
    )
    zero = jnp.zeros(())
    assert spring.torque(zero, zero) == 0.0, f"{name}: has a torque without deflection"
    for derivative in (jax.jacfwd, jax.jacrev):
        slopes = derivative(lambda s, d: (spring.torque(s, d), spring.stiffness(s, d)), (0, 1))(zero, zero)
        assert np.all(np.isfinite(jax.tree.leaves(slopes))), f"{name}: a slope without deflection is not finite"


def _check_basis(table: Any, basis: Any) -> None:
    name = type(table).__name__
    assert table.size == basis.size, f"{name}: the table has size {table.size}, what it builds {basis.size}"
    assert table.uses_setpoint == basis.uses_setpoint, f"{name}: table and class differ in uses_setpoint"
    features, slopes = _over_grid(basis)
    shape = (len(_SETPOINTS), len(_DEFLECTIONS), basis.size)
    assert features.shape == slopes.shape == shape, f"{name}: {features.shape} features, not {shape}"
    _close(
        f"{name}: slopes are not those of the features",
        slopes,
        _over_grid(jax.jacfwd(lambda s, d: basis(s, d)[0], 1)),
    )
    rows = np.asarray(features).reshape(-1, basis.size)
    scaled = rows / np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
    assert np.linalg.matrix_rank(scaled, tol=1e-12) == min(basis.size, len(rows)), (
        f"{name}: features depend on others"
    )
    depends = not np.array_equal(features[0], features[-1])
    assert depends == basis.uses_setpoint, f"{name}: uses_setpoint is {basis.uses_setpoint}; it is {depends}"


def _samples(needs: frozenset[str]) -> Sample:
    return Recording(jnp.asarray(_TIME), **{name: _WAVES[name] for name in needs}).samples()


def _torques_of(source: Any) -> Any:
    samples = _samples(source.needs)
    motion = Kinematics(
        deflection=_WAVES["deflection"],
        setpoint=_WAVES["setpoint_position"],
        motor_position=_WAVES["motor_position"],
        motor_velocity=_WAVES["motor_torque"],
    )
    return _scanned(lambda state, one: source.step(state, *one), source.init(_first(samples)), (samples, motion))


def _check_torque(table: Any, source: Any) -> None:
    _check_needs(table, source)
    samples = _samples(source.needs)
    motion = Kinematics(jnp.zeros(()), jnp.zeros(()), jnp.zeros(()), jnp.zeros(()))
    _check_state(
        type(table).__name__, source.init(_first(samples)), lambda s: source.step(s, _first(samples), motion)[0]
    )


def _velocities_of(velocity: Any) -> Any:
    readings = _WAVES["link_position"]
    steps = jnp.full(readings.shape, 1e-3)
    return _scanned(lambda state, one: velocity.step(state, *one), velocity.init(readings[0]), (readings, steps))


def _check_velocity(table: Any, velocity: Any) -> None:
    zero = jnp.zeros(())
    _check_state(type(table).__name__, velocity.init(zero), lambda s: velocity.step(s, zero, zero + 1e-3)[0])


def _weights_of(law: Any) -> Any:
    return jax.vmap(law)(jnp.asarray([0.0, 0.1, 1.0, 100.0])), law.memory()


def _answers_of(estimator: Any) -> Any:
    answer = estimation.estimate(estimator, _recording(estimator))
    return answer.stiffness, answer.elastic_torque


def _recording(estimator: Any) -> Recording:
    """Return the signals that an estimator needs and no other: the truth is not among those that there are."""
    return Recording(jnp.asarray(_TIME), **{name: _WAVES[name] for name in estimator.needs})


def _check_estimator(table: Any, estimator: Any) -> None:
    name = type(table).__name__
    _check_needs(table, estimator)
    recording = _recording(estimator)
    samples = recording.samples()
    first = _first(samples)
    _check_state(name, estimator.init(first), lambda s: estimator.step(s, first)[0])
    answer = jax.jit(estimation.estimate)(estimator, recording)
    assert np.all(np.isfinite(answer.stiffness)), f"{name}: the estimate is not finite"
    assert np.all(answer.stiffness_std >= 0.0), f"{name}: a standard deviation is negative"
    assert answer.known.dtype == bool, f"{name}: known is {answer.known.dtype}"
    assert not answer.known[0], f"{name}: says that it knows after one sample"
    online = _scanned(lambda s, x: estimator.step(s, x), estimator.init(first), samples)
    for field in ("stiffness", "elastic_torque"):
        _close(f"{name}: {field} online is not that offline", getattr(online, field), getattr(answer, field), 1e-9)
    assert table.size >= 1, f"{name}: size is {table.size}"


def _check_needs(table: Any, built: Any) -> None:
    name = type(table).__name__
    assert table.needs == built.needs, (
        f"{name}: the table needs {set(table.needs)}, what it builds {set(built.needs)}"
    )
    unknown = table.needs - Sensing.model_fields.keys()
    assert not unknown, f"{name}: needs {sorted(unknown)}, which no sensor reads"


def _signal_of(sensor: Any) -> Any:
    return sensor(jnp.asarray(_TIME), _WAVES["link_position"], key=jax.random.key(1))


def _motion_of(joint: Any) -> Any:
    torques = Torques(*(0.01 * _WAVES[n] for n in ("motor_torque", "motor_torque", "elastic_torque")))
    both = torques._replace(motor1=torques.motor, motor2=torques.setpoint_motor)
    motion = plants.simulate(joint, both, jnp.asarray(1e-4), substeps=2)
    return motion.stiffness, motion.elastic_torque, motion.link_position


def _swing_of(plant: Any) -> Any:
    start = plant.rest(jnp.asarray(1.0))
    command, torque = Command(jnp.asarray(1.0), jnp.asarray(0.1)), jnp.asarray(0.2)

    def step(state: Any, _: Any) -> tuple[Any, Any]:
        moved = plant.step(
            state, (command,) * len(state.positions), (torque,) * len(state.positions), jnp.asarray(1e-3)
        )
        return moved, moved.positions

    return jax.lax.scan(step, start, None, 20)[1]


def _commands_of(controller: Any) -> Any:
    found = _scanned(lambda s, x: controller.step(s, x), controller.init(_first(_SWING)), _SWING)
    return (found.stiffness, found.motor_position) if isinstance(found, Command) else found


def _check_controller(table: Any, controller: Any) -> None:
    first = _first(_SWING)
    _check_state(type(table).__name__, controller.init(first), lambda s: controller.step(s, first)[0])


def _check_state(name: str, before: Any, step: Callable[[Any], Any]) -> None:
    """Check that a state comes out of a step as it went in: else nothing can be run over time."""

    def signature(tree: Any) -> Any:
        return jax.tree.map(lambda x: (jnp.shape(x), jnp.result_type(x)), tree)

    after = step(before)
    assert signature(before) == signature(after), f"{name}: step returns a state of another shape or type"


def _scanned(step: Callable[[Any, Any], tuple[Any, Any]], state: Any, inputs: Any) -> Any:
    return jax.lax.scan(step, state, inputs)[1]


def _first(tree: Any) -> Any:
    return jax.tree.map(lambda x: x[0], tree)


def _close(what: str, found: Any, expected: Any, relative: float = 1e-8) -> None:
    scale = float(jnp.max(jnp.abs(expected), initial=0.0))
    worst = float(jnp.max(jnp.abs(found - expected), initial=0.0))
    assert worst <= relative * scale + 1e-12, f"{what}: {worst:.3g} off, of {scale:.3g}"


PROBES: Mapping[str, Probe] = {
    "springs": Probe(plants.AbstractSpring, _law_of, _check_spring),
    "joints": Probe(eqx.Module, _motion_of, may_draw=True),
    "excitations": Probe(sensing.AbstractExcitation, lambda torque: torque(jnp.asarray(_TIME)), may_draw=True),
    "sensors": Probe(eqx.Module, _signal_of, may_draw=True),
    "torques": Probe(estimators.AbstractTorqueSource, _torques_of, _check_torque),
    "velocities": Probe(estimators.AbstractVelocityFilter, _velocities_of, _check_velocity),
    "bases": Probe(estimators.AbstractBasis, lambda basis: _over_grid(basis), _check_basis),
    "laws": Probe(estimators.AbstractGainLaw, _weights_of),
    "estimators": Probe(estimators.AbstractEstimator, _answers_of, _check_estimator),
    "plants": Probe(eqx.Module, _swing_of, may_draw=True),
    "controllers": Probe(control.AbstractController, _commands_of, _check_controller),
    "rules": Probe(control.AbstractRule, _commands_of, _check_controller),
}
"""By slot."""
