"""Ménard, Grioli, Bicchi: A real-time observer for an agonist-antagonist variable stiffness actuator.

Scenarios R1, R2 (cubic springs), T1 (slow torques, 2° of encoder noise) and X1 (exponential springs), the printed
comparison, and the duel with the residual estimator; settings and corrections in `docs/antagonistic-joint.md`.
"""

from __future__ import annotations

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from tuning.kinds.estimation.substeps import choose_substeps, try_substeps
from tuning.papers.antagonistic.model import (
    CONSTANT,
    CONTINUOUS,
    MOTOR,
    ODD,
    R1,
    R2,
    SAMPLE_TIME,
    SAMPLED,
    SUBSTEPS,
    T1,
    X1,
    Setting,
    algebraic,
    bench_of,
    own_draws,
    record,
    reference_noise,
    residual,
    truth_of,
)
from tuning.papers.rows import Report, Row
from vsajax import Recording, Scorer, Scores, rollout
from vsajax import estimators as es
from vsajax.experiments import estimation

_TITLE = "Ménard, Grioli, Bicchi: agonist-antagonist joint and the algebraic observer"
_OWN_DRAWS = 64
_JUDGED_FROM = 2.0
"""By the scorer [s]."""
_SHARPEST = 1e16
"""The largest round P(0) of which enough digits are left to tell it from no prior, see `rounding_limit`."""


@jax.jit
def score(estimator: es.AntagonisticPair, recording: Recording, stiffness: jax.Array) -> Scores:
    """Score an estimator from 2 s on."""
    return estimation.score(estimator, recording, stiffness, scorer=Scorer())


_estimate = jax.jit(estimation.estimate)


@jax.jit
def _final_coefficients(estimator: es.AntagonisticPair, recording: Recording) -> tuple[jax.Array, ...]:
    """Return the first side's coefficients at the end of a recording."""
    prepared = estimator.offline(recording.samples())
    state = rollout.scan(prepared.step, prepared.state, prepared.inputs)[0]
    return state[0].fit.coefficients


def reproduce(folder: Path | None) -> Report:
    """Compute the rows, and draw the figures into `folder` unless it is `None`."""
    rows = [*_plant_rows(R1), *_plant_rows(R2), *_noise_free_rows(), *_noisy_rows(), *_printed_rows()]
    figures: list[Path] = []
    if folder is not None:
        from tuning.papers.antagonistic.figures import draw

        figures = draw(folder)
    return Report(_TITLE, rows, figures, _findings())


def _findings() -> list[str]:
    found = []
    for setting in (R1, R2):
        scores = _scores(algebraic(1e20), setting, np.zeros((5, 1)), 0.0, 0.0)
        found.append(
            f"{setting.name} at P(0) = 1e20, product integration: MSE {float(scores.mse_settled):.2g} (N·m/rad)² "
            "on this processor; not judged, for P keeps no digit of 1e20 and does not stay positive definite"
        )
    return found


def _close(name: str, measured: float, reference: float, unit: str, relative: float, note: str = "") -> Row:
    slack = relative * abs(reference)
    return Row(name, None, measured, unit, reference - slack, reference + slack, note)


def _plant_rows(setting: Setting) -> list[Row]:
    motion = truth_of(setting).motion
    finals = (motion.motor1_position[-1], motion.motor2_position[-1], motion.link_position[-1])
    error = max(abs(float(m) - r) for m, r in zip(finals, setting.reference, strict=True))
    sigma = np.asarray(motion.stiffness)[2000:]
    spread = (sigma.min(), sigma.mean(), sigma.max())
    worst = max(abs(m / r - 1.0) for m, r in zip(spread, setting.stiffness, strict=True))
    own = choose_substeps(bench_of(setting), SAMPLE_TIME, 1e-8)
    chosen = try_substeps(bench_of(setting), own).truth.motion
    names = ("motor1_position", "motor2_position", "link_position")
    apart = max(float(np.max(np.abs(getattr(chosen, name) - getattr(motion, name)))) for name in names)
    steps = f"integration_tolerance = 1e-8 asks for {own} steps a sample; over 10 s, against {SUBSTEPS}"
    return [
        Row(f"{setting.name} q1, q2, qL at 10 s, largest error", None, error, "rad", 0.0, 1e-8, "against Radau"),
        Row(f"{setting.name} positions with the chosen step, largest error", None, apart, "rad", 0.0, 1e-8, steps),
        Row(f"{setting.name} σ min, mean, max, largest error", None, float(worst), "relative", 0.0, 1e-5),
    ]


def _noise_free_rows() -> list[Row]:
    silence = np.zeros((5, 1))
    rows = []
    for setting, weighting, mse, msrep in (
        (R1, CONTINUOUS, 2.505658602178953, 0.35382912707822645),
        (R1, SAMPLED, 0.015002386367779938, 0.001712579857148275),
        (R2, CONTINUOUS, 0.9260868264192649, 1488.7252590396054),
        (R2, SAMPLED, 1.6726799488316354e-06, 0.0035766851568770734),
    ):
        name = f"{setting.name} {weighting['weighting']} weight, P(0) = 1e10"
        rows += _score_rows(name, algebraic(1e10, **weighting), setting, silence, mse, msrep)
    for weighting, coefficients in (
        (CONTINUOUS, (-4.952184220443412, -22.173586660999163, 14.43008703270493)),
        (SAMPLED, (-1.504438692397597, -5.071218377992428, 51.534974653204046)),
    ):
        recording = record(truth_of(R1), silence, 0.0, 0.0)
        found = _final_coefficients(algebraic(1e10, **weighting), recording)
        name = f"R1 {weighting['weighting']} weight"
        rows += [
            _close(f"{name}, a{j}", float(a), r, "N·m/rad", 1e-3)
            for j, (a, r) in enumerate(zip(found, coefficients, strict=True))
        ]
    for setting in (R1, R2):
        observer = algebraic(_SHARPEST)
        scores = _scores(observer, setting, silence, 0.0, 0.0)
        limit = rounding_limit(observer, record(truth_of(setting), silence, 0.0, 0.0))
        name = f"{setting.name} sample weight, P(0) = {_SHARPEST:g}, product integration: MSE"
        note = "allowed: n samples · d features · 2⁻⁵² · condition, and the pull of P(0); see `worst_errors`"
        rows.append(Row(name, None, float(scores.mse_settled), "(N·m/rad)²", 0.0, limit, note))
    for weighting, mse, msrep in (
        (CONTINUOUS, 37.44261117828417, 9.079114953464076),
        (SAMPLED, 1.2844149644793685, 0.31127738892650025),
    ):
        name = f"X1 order 10, {weighting['weighting']} weight, P(0) = 1e7"
        rows += _score_rows(name, algebraic(1e7, order=10, **weighting), X1, silence, mse, msrep)
    return [*rows, *_conditioning_rows()]


def rounding_limit(estimator: es.AntagonisticPair, recording: Recording) -> float:
    """Return the mean squared error that rounding and the prior may cause where the data fit the model exactly.

    Args:
        estimator: a pair of algebraic observers.
        recording: without noise.

    Returns:
        The limit from 2 s on [(N·m/rad)²].

    Raises:
        ValueError: rounding has no limit, as in `worst_errors`.
    """
    prepared = estimator.offline(recording.samples())
    final = rollout.scan(prepared.step, prepared.state, prepared.inputs)[0]
    judged = np.asarray(recording.time) >= _JUDGED_FROM
    total = np.zeros(())
    for side, state, rows, number in zip(estimator.both, final, prepared.inputs, (1, 2), strict=True):
        assert isinstance(side, es.AlgebraicObserver)
        sample = recording.samples().side(number)
        deflection = jax.vmap(lambda one: one.read("link_position") - one.read("motor_position"))(sample)
        slopes = jax.vmap(side.basis)(jnp.zeros_like(deflection), deflection)[1]
        features = np.asarray(rows.share)[:, None] * np.stack([np.asarray(f) for f in rows.features], axis=1)
        found = worst_errors(
            features, np.asarray(state.fit.coefficients), np.asarray(slopes), float(side.fit.prior_scale)
        )
        total = total + found[judged]
    return float(np.mean(total**2))


def worst_errors(features: np.ndarray, coefficients: np.ndarray, slopes: np.ndarray, prior: float) -> np.ndarray:
    """Return by how much recursive least squares in double precision may be off on data that fit exactly.

    After n samples of d features with S = Σ F Fᵀ and D = diag(S)^½, the coefficients D η are off by at most
    n d ε κ of their size: ε = 2⁻⁵², κ the condition of D⁻¹ S D⁻¹ (Higham, Accuracy and Stability of Numerical
    Algorithms, 2nd ed., §§ 3.1, 7.3, 20.4). The prior pulls η by (I + P(0) S)⁻¹ η. P is subtracted from P(0) and
    keeps an error of d ε P(0), which must be below its smallest eigenvalue, 1/λ_max(S): by their ratio the pull is
    uncertain, and where it reaches 1, P does not stay positive definite. No processor and no order of additions is
    worse.

    Args:
        features: F, `(time, d)`.
        coefficients: η, `(d,)`.
        slopes: what η is multiplied by at each sample, `(time, d)`.
        prior: P(0).

    Returns:
        `(time,)`; infinite until S is regular.

    Raises:
        ValueError: P does not stay positive definite: nothing bounds the error.
    """
    size, epsilon = features.shape[1], float(np.finfo(float).eps)
    squares = np.cumsum(features[:, :, None] * features[:, None, :], axis=0)
    largest = np.linalg.eigvalsh(squares[-1])[-1]
    blurred = size * epsilon * prior * largest
    if not blurred < 1.0:
        raise ValueError(f"P(0) = {prior:g} leaves no digit of a covariance of {1.0 / largest:.2g}")
    scale = np.sqrt(np.einsum("nii->ni", squares))
    scale = np.where(scale > 0.0, scale, 1.0)
    lowest, *_, highest = np.linalg.eigvalsh(squares / (scale[:, :, None] * scale[:, None, :])).T
    count = np.cumsum(np.any(features != 0.0, axis=1))
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = count * size * epsilon * highest / np.maximum(lowest, 0.0)
    reach = np.linalg.norm(slopes / scale, axis=1) * np.linalg.norm(scale * coefficients, axis=1)
    held = np.broadcast_to(coefficients, slopes.shape)[:, :, None]
    pulled = np.linalg.solve(np.eye(size) + prior * squares, held)[:, :, 0]
    return np.where(lowest > 0.0, reach * relative, np.inf) + np.abs(np.sum(slopes * pulled, axis=1)) / (
        1.0 - blurred
    )


def _conditioning_rows() -> list[Row]:
    """Return what the printed prior leaves undetermined on X1, and what a scaled basis does about it."""
    recording = record(truth_of(X1), np.zeros((5, 1)), 0.0, 0.0)
    rows = []
    for weighting, freedom in ((CONTINUOUS, 0.90), (SAMPLED, 1.89)):
        answer = _estimate(algebraic(1e7, order=10, **weighting), recording)
        name = f"X1 order 10, {weighting['weighting']} weight, P(0) = 1e7: effective d.o.f. of side 1, of 11"
        rows.append(_close(name, float(answer.sides[0].signals.determined[-1]), freedom, "1", 1e-2))
    scaled = es.AlgebraicObserver(
        **MOTOR,
        window=1.0,
        basis=es.Legendre(-0.75, 0.75, order=11),
        fit=es.RecursiveLeastSquares(1e10),
        scaling="scale_free",
    )
    scores = score(es.AntagonisticPair(scaled), recording, truth_of(X1).motion.stiffness)
    name = "X1 order 10, Legendre basis on ±0.75 rad: MSREP"
    return [*rows, Row(name, None, float(scores.msrep_settled), "%", 0.0, 0.01)]


def _noisy_rows() -> list[Row]:
    noise = reference_noise()
    rows = []
    for name, setting, estimator, mse in (
        ("R1 continuous weight", R1, algebraic(1e10, **CONTINUOUS), 2.494416787344413),
        ("R1 sample weight", R1, algebraic(1e10, **SAMPLED), 0.011771436983125709),
        ("R1 sample weight, zeros before", R1, algebraic(1e10, start="zeros", **SAMPLED), 0.0039281822978045325),
        ("R2 continuous weight", R2, algebraic(1e10, **CONTINUOUS), 0.9217660418219593),
        ("R2 sample weight", R2, algebraic(1e10, **SAMPLED), 0.0008308550498406017),
        ("R1 residual, odd basis, V_a = 100", R1, residual(ODD(deflection_terms=4), 100.0, 1e-3), 0.002207651),
        ("R1 residual, with constant, V_a = 1e3", R1, residual(CONSTANT(order=3), 1e3, 1e-3), 0.001573197),
    ):
        scores = _scores(estimator, setting, noise, 1e-3, 0.01)
        row = f"{name}, stored noise 1 mrad, 0.01 N·m: MSE"
        rows.append(_close(row, float(scores.mse_settled), mse, "(N·m/rad)²", 1e-3))
    return rows


def _printed_rows() -> list[Row]:
    """Return the printed comparison table beside T1, one reading of what it leaves open."""
    observer = algebraic(1e10, start="zeros", **SAMPLED)
    baseline = residual(CONSTANT(order=3), 0.026, 0.0344, start=1e4)
    stored = _scores(observer, T1, reference_noise(), 0.0344, 0.1)
    rows = [
        _close("T1 algebraic, stored noise: MSE", float(stored.mse_settled), 4.83424136435169, "(N·m/rad)²", 1e-3),
        _close("T1 algebraic, stored noise: MSREP", float(stored.msrep_settled), 0.690916717723581, "%", 1e-3),
    ]
    note = (
        "the printed settings leave torques, noise, filter and basis open; T1 is one of several readings that "
        "give the printed values, so they prove nothing about the missing ones. Judged against the median of an "
        f"independent reproduction; ours is over {_OWN_DRAWS} draws. The residual's value moves from 35 to 51 "
        "with the Kalman filter's start alone"
    )
    for name, estimator, printed, reference in (
        ("algebraic", observer, (4.2, 0.7), (4.8, 0.88)),
        ("residual", baseline, (51.8, 22.26), (51.5, 20.0)),
    ):
        scores = own_draws(estimator, T1, 0.0344, 0.1, _OWN_DRAWS)
        medians = (np.median(scores.mse_settled), np.median(scores.msrep_settled))
        for label, unit, value, shown, middle in zip(
            ("MSE", "MSREP"), ("(N·m/rad)²", "%"), medians, printed, reference, strict=True
        ):
            rows.append(
                Row(f"T1 {name}: {label}, median", shown, float(value), unit, 0.8 * middle, 1.2 * middle, note)
            )
    return rows


def _score_rows(
    name: str, estimator: es.AntagonisticPair, setting: Setting, noise: np.ndarray, mse: float, msrep: float
) -> list[Row]:
    scores = _scores(estimator, setting, noise, 0.0, 0.0)
    return [
        _close(f"{name}: MSE", float(scores.mse_settled), mse, "(N·m/rad)²", 1e-3),
        _close(f"{name}: MSREP", float(scores.msrep_settled), msrep, "%", 1e-3),
    ]


def _scores(
    estimator: es.AntagonisticPair, setting: Setting, noise: np.ndarray, position_std: float, torque_std: float
) -> Scores:
    truth = truth_of(setting)
    return score(estimator, record(truth, noise, position_std, torque_std), truth.motion.stiffness)
