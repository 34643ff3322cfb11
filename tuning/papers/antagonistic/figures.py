"""Figures of the antagonistic paper, and the window that it leaves open."""

from __future__ import annotations

from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from tuning.papers.antagonistic import model as paper
from tuning.pictures.style import ESTIMATE, OTHER, TRUTH, new_figure, save
from vsajax import estimators as es
from vsajax.experiments import estimation


def draw(folder: Path) -> list[Path]:
    """Draw every figure into `folder`."""
    return [
        _draw_simulation(folder),
        _draw_exponential(folder),
        _draw_window(folder),
    ]


def _stiffness(estimator: es.AbstractEstimator, recording: estimation.Recording) -> np.ndarray:
    return np.asarray(jax.jit(estimation.estimate)(estimator, recording).stiffness)


def _draw_simulation(folder: Path) -> Path:
    """Fig. 2: torques, and the stiffness by both approaches under noise, on T1."""
    truth = paper.truth_of(paper.T1)
    recording = paper.record(truth, paper.reference_noise(), 0.0344, 0.1)
    time, sigma = np.asarray(truth.time), np.asarray(truth.motion.stiffness)
    observer = paper.algebraic(1e10, start="zeros", **paper.SAMPLED)
    baseline = paper.residual(paper.CONSTANT(order=3), 0.026, 0.0344, start=1e4)
    figure, axes = new_figure(7.5, 5.2, 2, sharex=True, height_ratios=(1, 2))
    for torque, colour, name in (
        (truth.motion.motor1_torque, ESTIMATE, "τ₁"),
        (truth.motion.motor2_torque, OTHER, "τ₂"),
    ):
        axes[0].plot(time, torque, color=colour, label=name)
    axes[0].set_ylabel("motor torque\n[N·m]")
    axes[0].legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    axes[1].plot(time, _stiffness(baseline, recording), color=OTHER, linewidth=0.7, label="residual")
    axes[1].plot(time, _stiffness(observer, recording), color=ESTIMATE, linewidth=0.7, label="algebraic")
    axes[1].plot(time, sigma, "--", color=TRUTH, label="true")
    axes[1].set(ylim=(0.0, 1.35 * sigma.max()), xlabel="time [s]", ylabel="stiffness\n[N·m/rad]")
    axes[1].legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    figure.suptitle("T1: encoder noise 34 mrad, torque noise 0.1 N·m")
    return save(figure, folder / "fig2_simulation.png")


def _draw_exponential(folder: Path) -> Path:
    """Fig. 3: exponential springs, as printed (order 10, P(0) = 1e7) and with the prior that the problem needs."""
    truth = paper.truth_of(paper.X1)
    recording = paper.record(truth, paper.reference_noise(), 1e-3, 0.01)
    time, sigma = np.asarray(truth.time), np.asarray(truth.motion.stiffness)
    shown = time >= 1.0
    answers = (
        ("printed: order 10, continuous weight", paper.algebraic(1e7, order=10, **paper.CONTINUOUS), OTHER),
        ("order 4, weak prior", paper.algebraic(1e14, order=4), ESTIMATE),
    )
    figure, axes = new_figure(7.5, 5.0, 2, sharex=True)
    axes[0].plot(time, sigma, "--", color=TRUTH, label="true")
    for label, estimator, colour in answers:
        estimate = _stiffness(estimator, recording)
        axes[0].plot(time[shown], estimate[shown], color=colour, linewidth=0.9, label=label)
        axes[1].plot(time[shown], 100 * (estimate / sigma - 1.0)[shown], color=colour, linewidth=0.9)
    axes[0].set(ylabel="stiffness\n[N·m/rad]", ylim=(0.0, 1.2 * sigma.max()))
    axes[0].legend(loc="lower left", ncols=3, bbox_to_anchor=(0.0, 1.0), fontsize=8)
    axes[1].set(xlabel="time [s]", ylabel="relative error\n[%]", ylim=(-60, 60))
    figure.align_ylabels()
    return save(figure, folder / "fig3_exponential.png")


def _draw_window(folder: Path) -> Path:
    """MSREP against the window T on R1; every fit starts at 2 s, so that a short window has no head start."""
    windows = np.array([0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.4, 2.0])
    base = paper.algebraic(1e16, scaling="scale_free", longest_window=2.0)
    truth = paper.truth_of(paper.R1)
    figure, axis = new_figure(6.4, 3.8)
    for std, colour in ((1e-3, ESTIMATE), (1e-2, "#009e73"), (3e-2, OTHER)):

        def error(window: jax.Array, key: jax.Array, std: float = std) -> jax.Array:
            estimator = eqx.tree_at(lambda e: e.side.window, base, window)
            recording = paper.record(truth, jax.random.normal(key, (5, truth.time.shape[0])), std, 0.01)
            prepared = estimator.offline(recording.samples())
            # Rows before 2 s do not count, whatever the window.
            late = (truth.time >= 2.0).astype(truth.time.dtype)
            inputs = tuple(rows._replace(share=rows.share * late) for rows in prepared.inputs)
            answer = estimation.rollout.scan(prepared.step, prepared.state, inputs)[1]
            relative = (truth.motion.stiffness - answer.stiffness) / truth.motion.stiffness
            counted = truth.time >= 4.0
            return 100.0 * jnp.sum(jnp.where(counted, relative, 0.0) ** 2) / (jnp.sum(counted) - 1.0)

        keys = jax.random.split(jax.random.key(0), 5)
        values = jax.jit(jax.vmap(jax.vmap(error, (None, 0)), (0, None)))(jnp.asarray(windows), keys)
        middle = np.median(values, axis=1)
        axis.loglog(windows, middle, "o-", color=colour, label=f"{1e3 * std:g} mrad")
    axis.set(xlabel="window T [s]", ylabel="MSREP, 4 to 10 s [%]")
    axis.legend(title="encoder noise", loc="upper right")
    figure.suptitle("R1, weak scale-free prior: a knee at 0.2–0.3 s, then a plateau")
    return save(figure, folder / "window.png")
