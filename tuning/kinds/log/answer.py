"""What an estimator says of a recording, with all that is wrong with either."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from tuning.logs.analysis import Analysis, analyse, clock_facts, fault_facts, fault_sentences, leaves_floor
from tuning.logs.reading import RecordingTable
from tuning.logs.torques import Assumptions
from tuning.problem.build import build, build_estimator
from tuning.study.base import Config
from tuning.study.parts.estimators import (
    AlgebraicObserver,
    EstimatorTable,
    ExcitationGate,
    Polynomial,
    ResidualTorque,
    SeparableOddPolynomial,
)
from tuning.study.parts.estimators import AntagonisticPair as PairConfig
from tuning.study.parts.estimators import StiffnessEstimator as TwoStages
from vsajax import Estimate, Recording
from vsajax.estimators import AbstractEstimator, AntagonisticPair, RecursiveLeastSquares, StiffnessEstimator
from vsajax.experiments import estimation
from vsajax.jumps import FACTOR

_SHOWN = 3
"""Samples left out that are named."""
_PRIOR_LIMITS = 0.02
"""Change of the stiffness under a ten times weaker prior that is worth a warning."""


@dataclass(frozen=True)
class Answer:
    """An estimator's answer over a recording.

    Args:
        columns: time, stiffness, stiffness_std, elastic_torque, known; deflection and torque as used.
        summary: the end of the recording, what else it says, and the scores where the truth is known.
        sentences: the same for people.
        analysis: what the log says beyond its stiffness; `None` of an antagonistic pair.
    """

    columns: dict[str, np.ndarray]
    summary: dict[str, Any]
    sentences: list[str]
    analysis: Analysis | None = None


def estimate_recording(config: Config, table: RecordingTable) -> Answer:
    """Run the configured estimator over a recording and score it where it has a column true_stiffness."""
    signals = {name: jnp.asarray(table.columns[name]) for name in Recording._fields if name in table.columns}
    recording = Recording(**signals)
    estimator = build_estimator(config)
    # Both priors in one scan: a long log is run through once.
    both = jax.tree.map(lambda *x: jnp.stack(x), estimator, _with_weaker_prior(estimator))
    answers: Estimate = jax.jit(jax.vmap(estimation.estimate, in_axes=(0, None)))(both, recording)
    answer, weaker = (jax.tree.map(lambda x, i=i: x[i], answers) for i in (0, 1))
    columns = {
        "time": np.asarray(recording.time),
        "stiffness": np.asarray(answer.stiffness),
        "stiffness_std": np.asarray(answer.stiffness_std),
        "elastic_torque": np.asarray(answer.elastic_torque),
        "known": np.asarray(answer.known),
        "deflection": np.asarray(answer.signals.deflection),
        "torque": np.asarray(answer.signals.torque),
    }
    analysis = None
    if not isinstance(estimator, AntagonisticPair):
        torque, deflection = columns["torque"], columns["deflection"]
        lagging = deflection
        if isinstance(estimator, StiffnessEstimator) and estimator.torque.lag is not None:
            lagging = np.asarray(jax.jit(estimation.agreement)(estimator, recording)[1])
        analysis = analyse(table, lagging, torque, assumptions_of(config.estimator), unlagged=deflection)
        if analysis.floor is not None:
            columns["known"] = columns["known"] & leaves_floor(torque, analysis.floor)
    summary, sentences = _summarise(columns, config, analysis)
    left_out, told = _say_left_out(answer, columns["time"])
    summary |= left_out
    sentences += told
    if analysis is not None:
        summary |= analysis.summary()
        sentences += analysis.sentences()
    else:
        summary |= fault_facts(table.faults)
        sentences += fault_sentences(table.faults)
    summary["clock"] = clock_facts(table)
    prior, warning = _weigh_prior(answer, weaker)
    summary |= prior
    sentences += warning
    if "true_stiffness" in table.columns:
        scorer = build(config.scorer)
        truth = jnp.asarray(table.columns["true_stiffness"])
        scores = jax.jit(estimation.score_estimate)(recording.time, truth, answer, scorer=scorer)
        summary["scores"] = {name: float(value) for name, value in scores._asdict().items()}
        since = summary["scores"]["convergence_time"]
        share = f"within {100 * config.scorer.tolerance:g} %"
        reached = f"{share} after {since:.3g} s" if math.isfinite(since) else f"not {share} at the end"
        sentences.append("; ".join([*_describe_scores(summary["scores"], config.scorer.warm_up), reached]))
    return Answer(columns, summary, sentences, analysis)


def _say_left_out(answer: Estimate, time: np.ndarray) -> tuple[dict[str, Any], list[str]]:
    """Return how many samples were left out of the estimate, and the first of them in words."""
    held = np.flatnonzero(np.asarray(answer.held))
    facts = {"left_out": held.size}
    if not held.size:
        return facts, []
    shown = ", ".join(f"{time[k]:.6g}" for k in held[:_SHOWN])
    more = ", …" if held.size > _SHOWN else ""
    return facts, [
        f"left out of the estimate: {held.size} of {time.size} samples, with a reading that is no number or "
        f"changed by more than {FACTOR:g} times any change before (at {shown}{more} s)"
    ]


def _with_weaker_prior(estimator: AbstractEstimator) -> AbstractEstimator:
    """Return the estimator with priors ten times as weak; one without a recursive fit as it is."""

    def priors(e: Any) -> list[Any]:
        parts: tuple[Any, ...] = (e.side, e.other) if isinstance(e, AntagonisticPair) else (e,)
        fits = [getattr(part, "fit", None) for part in parts]
        return [fit.prior_scale for fit in fits if isinstance(fit, RecursiveLeastSquares)]

    return (
        eqx.tree_at(priors, estimator, [10.0 * scale for scale in priors(estimator)])
        if priors(estimator)
        else estimator
    )


def _weigh_prior(answer: Estimate, weaker: Estimate) -> tuple[dict[str, Any], list[str]]:
    """Compare an answer with that of a weaker prior: where they differ, the data do not decide."""
    known = np.asarray(answer.known)
    determined = float(answer.signals.determined[-1])
    if not known.any():
        return {"determined_coefficients": determined, "prior_influence": math.nan}, []
    own, other = np.asarray(answer.stiffness)[known], np.asarray(weaker.stiffness)[known]
    size = float(np.mean(own**2))
    influence = math.sqrt(float(np.mean((own - other) ** 2)) / size) if size > 0.0 else math.nan
    facts = {"determined_coefficients": determined, "prior_influence": influence}
    if not influence > _PRIOR_LIMITS:
        return facts, []
    return facts, [
        f"WARNING: the prior, not the data, limits the fit: ten times weaker, it changes the stiffness by "
        f"{100 * influence:.2g} % (the data determine {determined:.2g} coefficients). "
        "Raise fit.prior_scale, scale the basis, or excite the joint more"
    ]


def _describe_scores(scores: dict[str, float], warm_up: float) -> list[str]:
    """Return the scores that there are in words."""
    if not math.isfinite(scores["msrep"]):
        return ["against the truth: no score, the estimate or the truth is not finite or zero"]
    said = f"against the truth: MSREP {scores['msrep']:.4g} %"
    if math.isfinite(scores["msrep_settled"]):
        return [f"{said}, from {warm_up:g} s on {scores['msrep_settled']:.4g} %"]
    return [f"{said}; the recording ends before {warm_up:g} s, from where a settled score counts (scorer.warm_up)"]


def _why_unknown(columns: dict[str, np.ndarray], config: Config, analysis: Analysis | None) -> str:
    """Return which condition of *known* was never met, in words."""
    faulty = analysis is not None and analysis.is_faulty
    if faulty:
        return "something is wrong with the log, see the WARNING"
    if (
        analysis is not None
        and analysis.floor is not None
        and not leaves_floor(columns["torque"], analysis.floor).any()
    ):
        return "the torque never leaves its noise floor (expect.no_load)"
    estimator = config.estimator
    gate = getattr(estimator.side if isinstance(estimator, PairConfig) else estimator, "gate", None)
    if not isinstance(gate, ExcitationGate):
        return f"the estimator {estimator.tag!r} never says that it knows it"
    span = float(np.ptp(columns["deflection"]))
    if span < gate.min_deflection_range:
        return (
            f"the deflection moves by {1e3 * span:.3g} mrad in all, and estimator.gate.min_deflection_range "
            f"asks for {1e3 * gate.min_deflection_range:.3g}: excite the joint more, or lower it"
        )
    is_some = np.abs(columns["stiffness"]) > 1e-12 * float(np.max(np.abs(columns["stiffness"]), initial=0.0))
    # A stiffness of zero has no relative deviation.
    shares = columns["stiffness_std"][is_some] / np.abs(columns["stiffness"][is_some])
    least = float(np.min(shares[np.isfinite(shares)], initial=math.inf))
    least_said = f"{100 * least:.3g} % at best" if math.isfinite(least) else "unknown"
    return (
        f"its standard deviation is {least_said}, and estimator.gate.max_relative_std asks for "
        f"{100 * gate.max_relative_std:.3g} %: the joint is excited too little, or the basis does not fit it"
    )


def _summarise(
    columns: dict[str, np.ndarray], config: Config, analysis: Analysis | None
) -> tuple[dict[str, Any], list[str]]:
    known = columns["known"]
    stiffness, std = float(columns["stiffness"][-1]), float(columns["stiffness_std"][-1])
    known_from = float(columns["time"][np.argmax(known)]) if known.any() else math.inf
    summary = {
        "final_stiffness": stiffness,
        "final_stiffness_std": std,
        "final_known": bool(known[-1]),
        "known_from": known_from,
        "known_share": float(np.mean(known)),
        "samples": known.size,
        "diverged": bool(not np.isfinite(columns["stiffness"]).all()),
    }
    if summary["diverged"]:
        return summary, [
            "the estimate DIVERGED: it is not finite from "
            f"t = {columns['time'][np.argmax(~np.isfinite(columns['stiffness']))]:.3f} s on"
        ]
    if not known.any():
        summary["unknown_because"] = _why_unknown(columns, config, analysis)
        return summary, [f"the stiffness is NOT KNOWN: {summary['unknown_because']}"]
    sentences = [
        f"known from {known_from:.3f} s on" + ("" if known[-1] else ", but no longer at the end"),
        f"final stiffness {stiffness:.6g} ± {std:.2g} N·m/rad (one standard deviation)",
    ]
    return summary, sentences


def assumptions_of(estimator: EstimatorTable) -> Assumptions:
    """Return what an estimator takes for granted of a log; of one a side, the first. Of a foreign one, nothing."""
    if isinstance(estimator, PairConfig):
        estimator = estimator.side
    if not isinstance(estimator, AlgebraicObserver | TwoStages):
        return Assumptions(estimator.tag)
    basis = estimator.basis
    if isinstance(basis, SeparableOddPolynomial):
        has_offset = basis.deflection_offset or basis.torque_bias
    else:
        has_offset = isinstance(basis, Polynomial)
    if isinstance(estimator, AlgebraicObserver):
        return Assumptions("algebraic", True, False, has_offset)
    source = estimator.torque
    is_residual = isinstance(source, ResidualTorque)
    has_friction = not is_residual or bool(source.friction_torque)
    return Assumptions(source.tag, estimator.matched or not is_residual, has_friction, has_offset)
