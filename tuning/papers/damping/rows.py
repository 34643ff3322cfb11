"""Gasparri et al.: Variable Stiffness Control for Oscillation Damping, settling times, optimum and anticipation.

Every number is computed here; the constants are the printed values and those of an independent, event-accurate
NumPy and SciPy reproduction. Readings and corrections are in `docs/damping.md`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from tuning.papers.damping.model import (
    BAND,
    CONTROLLERS,
    IMPULSE,
    INERTIA,
    SOFT,
    STIFF,
    TRAVEL,
    arm_loop,
    arm_settling,
    best_end,
    exact,
    law_cost,
    law_over_optimum,
    link_loop,
    mean_settling,
    motion_of,
    optimal_costs,
    oscillator,
    scores_over,
    simulated_rate,
    tuned_conic,
)
from tuning.papers.rows import Report, Row
from vsajax import ControlLoop, SwingScores, control, switching

_TITLE = "Gasparri et al.: variable stiffness control for oscillation damping"
_SHARES = (0.2055, 0.2552)
"""Of the last peaks, at which the reference's relative thresholds lie."""
_PRINTED = {"soft": 2.06, "stiff": 2.18, "law": 0.93}
_R1 = {"soft": 2.2410541, "stiff": 2.0762210, "law": 0.9075196}
_R3 = {"soft": 2.2264440, "stiff": 1.7677261, "law": 0.7609549}
_POSITIONS = {
    "soft": (-1.0378771, -0.0215757),
    "stiff": (0.3635527, -0.2580145),
    "law": (-0.1032507, -0.0271465),
}
_SWITCHES = np.array([0.0850070, 0.2678425, 0.3528495, 0.5356850, 0.6206919, 0.8035274])
_ARM = {"soft": (6.2376, 3.9872), "stiff": (4.5731, 1.8237), "law": (1.01382, 0.43328)}
_ARM_PRINTED = {"soft": (None, 5.738), "stiff": (2.438, 2.032), "law": (2.098, 2.078)}


def reproduce(folder: Path | None) -> Report:
    """Compute and judge every row; draw the figures into `folder` unless it is `None`."""
    from tuning.papers.damping import antagonism, estimation

    rows = [
        *_settling_rows(),
        *_motion_rows(),
        *_rate_rows(),
        *_optimum_rows(),
        *_anticipation_rows(),
        *_arm_rows(),
        *estimation.rows(),
        *antagonism.rows(),
    ]
    figures: list[Path] = []
    if folder is not None:
        from tuning.papers.damping.figures import draw

        figures = [*draw(folder), estimation.draw(folder), antagonism.draw(folder)]
    return Report(_TITLE, rows, figures, _findings())


def _near(name: str, measured: float, wanted: float, tolerance: float, unit: str, **more: Any) -> Row:
    return Row(name, more.pop("printed", None), measured, unit, wanted - tolerance, wanted + tolerance, **more)


def _settling_rows() -> list[Row]:
    rows = []
    for name, wanted in _R1.items():
        exactly = exact(name, impulse=IMPULSE).settling_time(oscillator(), jnp.asarray(BAND))
        note = (
            f"the printed {_PRINTED[name]} s cannot be met together with the others: for a short blow, linear "
            "friction makes soft 0.39 s slower than stiff, the reverse of what is printed, and no impulse gives "
            f"two of the three. Judged against reading R1, {wanted} s"
        )
        printed = _PRINTED[name]
        rows.append(
            _near(f"settling, {name}, events", float(exactly), wanted, 1e-4, "s", printed=printed, note=note)
        )
    for name, wanted in _R1.items():
        stepped = float(_scores(link_loop(CONTROLLERS[name])).settling_time)
        rows.append(_near(f"settling, {name}, fixed step 0.5 ms", stepped, wanted, 0.01 * wanted, "s"))
    for name, wanted in _R3.items():
        motion = exact(name, pulse=(1.0, 0.05))
        settled = float(motion.settling_time(oscillator(), jnp.asarray(BAND)))
        rows.append(_near(f"settling, {name}, 1 N·m for 50 ms", settled, wanted, 1e-4, "s"))
    settled = {row.name: row.measured for row in rows}
    speed_up = settled["settling, soft, events"] / settled["settling, law, events"]
    note = "the printed times make 2.06/0.93 = 2.2, which the paper calls an improvement of 100 %; R1 makes 2.47"
    rows.append(Row("settling, soft over law", 2.06 / 0.93, speed_up, "1", 2.4, 2.6, note))
    return rows


def _scores(loop: ControlLoop) -> SwingScores:
    return jax.tree.map(lambda x: x[0], scores_over(loop, lambda one: [one.impact.impulse], np.array([[IMPULSE]])))


def _motion_rows() -> list[Row]:
    motion = exact("law", impulse=IMPULSE)
    off = float(np.abs(np.asarray(motion.switch_times)[:6] - _SWITCHES).max())
    rows = [Row("law's first six switches, largest difference from the reference", None, off, "s", 0.0, 1e-5)]
    for name, wanted in _POSITIONS.items():
        found, _ = exact(name, impulse=IMPULSE).at(oscillator(), jnp.array([0.5, 1.0]))
        for time, value, reference in zip((0.5, 1.0), found.position, wanted, strict=True):
            rows.append(_near(f"q({time}), {name}", float(value), reference, 1e-5, "rad"))
    return rows


def _rate_rows() -> list[Row]:
    soft, stiff = jnp.asarray(SOFT), jnp.asarray(STIFF)
    free = 2.0 * float(switching.decay_rate(oscillator(0.0), soft, stiff))
    with_friction = float(switching.decay_rate(oscillator(), soft, stiff))
    constant = float(switching.decay_rate(oscillator(), soft, soft))
    rows = [
        _near("amplitude decay, constant stiffness", constant, 1.533742, 1e-5, "1/s"),
        _near("amplitude decay, law", with_friction, 3.783, 0.005 * 3.783, "1/s"),
        _near("energy rate, law, no friction", free, 4.7507, 1e-3, "1/s"),
    ]
    phase = float(switching.best_release(jnp.asarray(SOFT / STIFF)))
    rows.append(_near("best release, phase past the peak, 0.3", phase, 0.1398, 0.02 * 0.1398, "rad"))
    for stiff_end, low, high, label in (
        (1.0, 0.0379 * 0.98, 0.0379 * 1.02, "0.3"),
        (13.0, 0.40, np.inf, "0.3/13"),
    ):
        ratio = jnp.asarray(SOFT / stiff_end)
        best = switching.best_release(ratio)
        closed = float(switching.release_rate(ratio, best) / switching.release_rate(ratio, 0.0 * best) - 1.0)
        share = float(best) / (0.5 * np.pi)
        simulated = simulated_rate(share, SOFT, stiff_end) / simulated_rate(0.0, SOFT, stiff_end) - 1.0
        note = "delayed release, a rule without a model; the paper calls law (23) optimal"
        rows.append(
            Row(f"gain in energy rate over the law, {label}, closed form", None, closed, "1", low, high, note)
        )
        rows.append(Row(f"gain in energy rate over the law, {label}, simulated", None, simulated, "1", low, high))
    return rows


def _optimum_rows() -> list[Row]:
    costs = optimal_costs()
    rows = []
    for label, time, best, law, tolerance in (
        ("φ of the paper", 0.15, 2.875560e-3, 4.599706e-2, 1e-4),
        ("energy at k_min", 0.75, 6.220293e-3, 1.350000e-2, 1e-3),
    ):
        at = jnp.asarray(time)
        found = float(best_end(at, costs[label]).cost)
        rows.append(_near(f"optimum, {label}, T = {time} s", found, best, tolerance * best, "rad²/s²"))
        own = float(law_cost(at, costs[label]))
        rows.append(_near(f"law, {label}, T = {time} s", own, law, tolerance * law, "rad²/s²"))
    return rows


def _anticipation_rows() -> list[Row]:
    fine: dict[str, Any] = {"sample_time": 1e-4, "travel": TRAVEL, "duration": 3.0}
    law = float(mean_settling(link_loop(CONTROLLERS["law"], **fine))[0])
    lead = control.StiffnessSwitch(SOFT, STIFF, control.TimeLead(0.5 * TRAVEL, 0.5 * TRAVEL))
    led = float(mean_settling(link_loop(lead, **fine))[0])
    longer: dict[str, Any] = {**fine, "duration": 4.0}
    shares = control.StiffnessSwitch(SOFT, STIFF, control.RelativeThresholds(*_SHARES))
    relative = mean_settling(link_loop(shares, **longer), (INERTIA, 2 * INERTIA))
    (a, c), *_ = tuned_conic()
    tuned = control.StiffnessSwitch(SOFT, STIFF, control.Conic(a, c))
    own, double = map(float, mean_settling(link_loop(tuned, travel=TRAVEL), (INERTIA, 2 * INERTIA)))
    note = f"a = {a:.3g} s, c = {c:.3g} 1/s: the best of a grid by log-energy at I; 2I is another robot"
    peaks = "the last peak is the larger of this half-swing's and of the one before"
    return [
        _near(
            "mean settling, actuator 0.1 s, relative thresholds, I",
            float(relative[0]),
            1.026,
            0.03,
            "s",
            note=peaks,
        ),
        _near("mean settling, actuator 0.1 s, relative thresholds, 2I", float(relative[1]), 1.416, 0.04, "s"),
        _near("mean settling, actuator 0.1 s, law", law, 1.754, 0.02 * 1.754, "s"),
        _near("mean settling, actuator 0.1 s, time-lead 0.05 s", led, 1.098, 0.02 * 1.098, "s"),
        Row("mean settling, actuator 0.1 s, conic tuned, I", None, own, "s", 0.0, 1.05, note),
        Row("mean settling, actuator 0.1 s, conic tuned, 2I", None, double, "s", 0.0, 1.50),
    ]


def _arm_rows() -> list[Row]:
    rows = []
    for name, wanted in _ARM.items():
        found = arm_settling(motion_of(arm_loop(CONTROLLERS[name])))
        for joint, (value, reference, printed) in enumerate(
            zip(found, wanted, _ARM_PRINTED[name], strict=True), start=1
        ):
            tolerance = (1e-2 if name == "law" else 1e-3) * reference
            note = ""
            if printed is not None:
                note = (
                    "the paper's arm: its inertias, friction and impact are not given, and its stiffness range, "
                    "[0.3, 13] N·m/rad, is another; judged against the event-accurate reference of our choice"
                )
            rows.append(
                _near(f"arm, {name}, joint {joint}", value, reference, tolerance, "s", printed=printed, note=note)
            )
    return rows


def _findings() -> list[str]:
    times = (0.15, 0.2535, 0.4, 0.75, 1.0)
    ratios = {label: law_over_optimum(np.array(times), cost) for label, cost in optimal_costs().items()}
    at = ", ".join(f"{t:g}" for t in times)
    found = [
        f"law (23) over the optimum at T = {at} s, {label}: {', '.join(f'{r:.3g}' for r in each)}"
        for label, each in ratios.items()
    ]
    fixed = control.StiffnessSwitch(SOFT, STIFF, control.FixedThresholds(0.0594, 0.743))
    cycle = _scores(link_loop(fixed, travel=TRAVEL, inertia=2 * INERTIA, duration=12.0, sample_time=1e-3))
    found.append(
        f"fixed thresholds (0.0594 rad, 0.743 rad/s) at 2I end in a limit cycle of {float(cycle.residual):.3f} "
        "rad: below the thresholds they are law (23) inverted"
    )
    both = zip(_ARM_PRINTED["stiff"], _ARM_PRINTED["law"], strict=True)
    changes = [
        f"joint {joint} {stiff} to {law} s is {100 * (law / stiff - 1):+.1f} %"
        for joint, (stiff, law) in enumerate(both, start=1)
        if stiff is not None and law is not None
    ]
    found.append(f"the paper's 25 % for the arm does not follow from its own numbers: {', '.join(changes)}")
    return found
