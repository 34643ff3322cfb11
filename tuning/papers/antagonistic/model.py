"""The paper's scenarios, observers and noise, as the rows, the figures and the duel use them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import jax
import numpy as np

from tuning.kinds.estimation.substeps import try_substeps
from vsajax import Bench, Recording, Scorer, Scores, Truth, plants, rollout
from vsajax import estimators as es
from vsajax import sensing as se
from vsajax.experiments import estimation

MOTOR: dict[str, Any] = {"motor_inertia": 1e-4, "motor_damping": 1.27}
SAMPLE_TIME = 1e-3
SUBSTEPS = 256
"""The near-unregularised rows ask for a motion that is exact to 1e-10 rad."""
_SEED = 20240601
"""Of the reference's noise, one draw for every scenario."""


@dataclass(frozen=True)
class Setting:
    """A simulated scenario.

    Args:
        name: as in the docs.
        torques: (offset, amplitude [N·m], frequency [Hz], phase [rad]) of each motor.
        reference: q₁, q₂, q_L at 10 s of an independent Radau integration [rad].
        stiffness: its smallest, mean and largest σ from 2 s on [N·m/rad].
    """

    name: str
    torques: tuple[tuple[float, float, float, float], ...]
    reference: tuple[float, ...] = ()
    stiffness: tuple[float, ...] = ()

    @property
    def joint(self) -> plants.AntagonisticJoint:
        """The joint of the scenario."""
        return plants.vsa_exponential() if self.name == "X1" else plants.menard_cubic()


R1 = Setting(
    "R1",
    ((2.5, 1.5, 0.5, 0.0), (-2.5, 1.5, 0.7, 0.0)),
    (0.6353417492236132, -0.6348136719265437, -0.003025991118682686),
    (14.474282848095118, 23.746842520266863, 32.18092830752263),
)
R2 = Setting(
    "R2",
    ((0.0, 3.0, 0.5, 0.0), (0.0, -3.0, 0.7, 0.0)),
    (-0.4732528906719367, 0.4764964906906062, 0.0095123530953081),
    (0.017612927090795504, 5.531881350999935, 17.814866443162074),
)
T1 = Setting("T1", ((2.724, 3.097, 0.0772, 4.120), (-2.858, -1.230, 0.0628, 3.519)))
X1 = Setting("X1", ((-2.5, -1.5, 0.5, 0.0), (2.5, 1.5, 0.7, 0.0)))


def excitation(setting: Setting) -> se.Excitation:
    """Return the torques of a scenario."""
    first, second = (se.Sine(amplitude=a, frequency=f, phase=p, offset=o) for o, a, f, p in setting.torques)
    return se.Excitation(motor1=first, motor2=second)


def bench_of(setting: Setting) -> Bench:
    """Return the joint of a scenario, driven for 10 s at 1 kHz; its sensors are silent."""
    return Bench(
        joint=setting.joint,
        excitation=excitation(setting),
        sensing=se.SensorSuite(),
        estimator=algebraic(1e10),
        scorer=Scorer(),
        clock=se.Clock(SAMPLE_TIME, 10.0),
    )


@cache
def truth_of(setting: Setting) -> Truth:
    """Return the scenario's motion over 10 s at 1 kHz."""
    return try_substeps(bench_of(setting), SUBSTEPS).truth


def record(truth: Truth, noise: Any, position_std: float, torque_std: float) -> Recording:
    """Return the recording with `(5, time)` unit noise on q₁, q₂, q_L, τ₁, τ₂."""
    motion = truth.motion
    return Recording(
        truth.time,
        link_position=motion.link_position + position_std * noise[2],
        motor1_position=motion.motor1_position + position_std * noise[0],
        motor2_position=motion.motor2_position + position_std * noise[1],
        motor1_torque=motion.motor1_torque + torque_std * noise[3],
        motor2_torque=motion.motor2_torque + torque_std * noise[4],
    )


def reference_noise() -> np.ndarray:
    """Return the unit noise of the reference: single precision, one draw for all scenarios."""
    return np.random.default_rng(_SEED).standard_normal((5, 10001)).astype(np.float32).astype(float)


def algebraic(prior: float, *, order: int = 2, **options: Any) -> es.AntagonisticPair:
    """Return the algebraic observer on both sides, T = 1 s."""
    fit = es.RecursiveLeastSquares(prior)
    side = es.AlgebraicObserver(**MOTOR, window=1.0, basis=es.Taylor(order=order), fit=fit, **options)
    return es.AntagonisticPair(side)


def residual(
    basis: es.AbstractBasis, acceleration_variance: float, position_std: float, *, start: float = 100.0
) -> es.AntagonisticPair:
    """Return the residual estimator on both sides, K_I = 1e3 and P(0) = 1e6.

    V_a is printed nowhere, nor is the filter's start: the first reading with variance R, and a velocity variance
    of `start` [rad²/s²], 100 in the reference's R1 and R2.
    """
    variance = max(position_std**2, 1e-14)
    return es.AntagonisticPair(
        es.StiffnessEstimator(
            torque=es.ResidualTorque(observer_gain=1e3, **MOTOR),
            basis=basis,
            fit=es.RecursiveLeastSquares(1e6),
            velocity=es.KinematicKalman(acceleration_variance, variance, variance, start),
            matched=False,
        )
    )


ODD = es.SeparableOddPolynomial
CONSTANT = es.Polynomial
CONTINUOUS: dict[str, Any] = {"weighting": "continuous", "quadrature": "trapezoid"}
SAMPLED: dict[str, Any] = {"weighting": "sample", "quadrature": "trapezoid"}


def own_draws(
    estimator: es.AntagonisticPair, setting: Setting, position_std: float, torque_std: float, draws: int
) -> Scores:
    """Return the scores over independent noise draws, `(draw,)` a field."""
    truth = truth_of(setting)

    def one(key: jax.Array, common: tuple[es.AntagonisticPair, Truth]) -> Scores:
        chosen, motion = common
        noise = jax.random.normal(key, (5, motion.time.shape[0]))
        recording = record(motion, noise, position_std, torque_std)
        return estimation.score(chosen, recording, motion.motion.stiffness, scorer=Scorer())

    keys = jax.random.split(jax.random.key(_SEED), draws)
    return jax.jit(lambda k, common: rollout.map_lanes(one, k, common, chunk=16))(keys, (estimator, truth))
