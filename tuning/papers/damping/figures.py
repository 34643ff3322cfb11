"""Figures of the damping paper on stated parameters, and what it leaves open: the optimum, and slow actuators."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

from tuning.papers.damping import model as paper
from tuning.pictures.style import ESTIMATE, OTHER, QUIET, TRUTH, new_figure, save
from vsajax import ControlLoop, control, plants, switching
from vsajax import sensing as se

_GREEN, _PINK = "#009e73", "#cc79a7"
_COLOURS = {"soft": ESTIMATE, "stiff": OTHER, "law": TRUTH}
_LABELS = {"soft": "constant, $k_{min}$", "stiff": "constant, $k_{max}$", "law": "law (23)"}
_OVER_LINES: dict[str, Any] = {"facecolor": "white", "frameon": True, "framealpha": 0.9, "edgecolor": "none"}
"""Of a legend that lies on curves: its text stays readable."""
_MIDDLE = 0.5 * (paper.SOFT + paper.STIFF)
_MOTOR = plants.PositionMotor(0.03, 6.0)
"""A position motor: an assumption, the paper gives none."""
_BLOW = 0.02
_OBSERVER = control.SwingObserver(60.0)


def draw(folder: Path) -> list[Path]:
    """Draw every figure into `folder`."""
    return [
        _draw_three(folder),
        *_draw_comparison(folder),
        _draw_thresholds(folder),
        *_draw_arm(folder),
        _draw_optimum(folder),
        _draw_slew(folder),
        _draw_conic(folder),
    ]


def _draw_three(folder: Path) -> Path:
    """Fig. 3: stiffness and position at both constant stiffnesses and under the law, event-accurate."""
    time = np.linspace(0.0, 2.5, 5001)
    figure, axes = new_figure(7.5, 4.6, 2, sharex=True, height_ratios=(1, 2))
    for name, colour in _COLOURS.items():
        motion = paper.exact(name, impulse=paper.IMPULSE)
        phase, stiffness = motion.at(paper.oscillator(), jnp.asarray(time))
        settled = float(motion.settling_time(paper.oscillator(), jnp.asarray(paper.BAND)))
        axes[0].plot(time, stiffness, color=colour)
        axes[1].plot(time, phase.position, color=colour, label=f"{_LABELS[name]}: {settled:.3f} s")
        axes[1].axvline(settled, color=colour, linestyle=":")
    axes[1].axhspan(-paper.BAND, paper.BAND, color=QUIET, alpha=0.5, linewidth=0)
    axes[0].set_ylabel("stiffness\n[N·m/rad]")
    axes[1].set(xlabel="time after the impact [s]", ylabel="position [rad]")
    axes[1].legend(loc="upper right", title=f"within ±{paper.BAND:g} rad after", **_OVER_LINES)
    figure.suptitle("Fig. 3: I = 0.00326 kg·m², b = 0.01 N·m·s/rad, impulse 0.069 N·m·s")
    return save(figure, folder / "fig3_settling.png")


def position_loop(
    controller: control.AbstractController, inertia: float = paper.INERTIA, **more: Any
) -> ControlLoop:
    """Return the loop of the comparison: 1 kHz, a motor of 30 ms and 6 rad/s, impulse 0.02 N·m·s."""
    options: dict[str, Any] = {"sensor": se.FeedbackSensor(), "observer": _OBSERVER, "sample_time": 1e-3} | more
    return paper.link_loop(controller, inertia=inertia, impulse=_BLOW, motor=_MOTOR, **options)


def _gains(loop: ControlLoop) -> list[Any]:
    own: Any = loop.controller
    return [own.proportional, own.integral, own.derivative]


def _bring_back(loop: ControlLoop) -> list[Any]:
    own: Any = loop.controller
    return [own.lead, own.return_time]


def tuned_pid(inertia: float) -> control.PIDPosition:
    """Return the PID whose log-energy is least at an inertia, of a grid of gains."""
    blank = control.PIDPosition(_MIDDLE, 0.0, 0.0, 0.0)
    grid = np.array(
        [(p, i, d) for p in np.linspace(0, 2, 6) for i in (0.0, 1.0, 4.0) for d in np.linspace(0, 0.3, 16)]
    )
    energy = np.asarray(paper.scores_over(position_loop(blank, inertia), _gains, grid).log_energy)
    return control.PIDPosition(_MIDDLE, *grid[np.nanargmin(energy)])


def tuned_bang_bang(inertia: float) -> control.BangBangPosition:
    """Return the bang-bang control whose log-energy is least at an inertia, of a grid of lead and time back."""
    blank = control.BangBangPosition(_MIDDLE, 0.5, 0.02)
    grid = np.array([(lead, back) for lead in np.linspace(0, 0.06, 13) for back in np.linspace(0.2, 1.0, 17)])
    energy = np.asarray(paper.scores_over(position_loop(blank, inertia), _bring_back, grid).log_energy)
    lead, back = grid[np.nanargmin(energy)]
    return control.BangBangPosition(_MIDDLE, back, 0.02, lead)


def _draw_comparison(folder: Path) -> list[Path]:
    """Figs. 4 and 5: null control, PID, bang-bang position and stiffness switching, at I and 2I."""
    pid, bang = tuned_pid(paper.INERTIA), tuned_bang_bang(paper.INERTIA)
    retuned = tuned_pid(2 * paper.INERTIA)
    # Stable at I if Ki is below the limit of Routh; 0.75 of it is beyond that of 2I.
    proportional, derivative = 0.5, 0.05
    limit = (paper.DAMPING + _MIDDLE * derivative) * (1 + proportional) / paper.INERTIA
    eager = control.PIDPosition(_MIDDLE, proportional, 0.75 * limit, derivative, longest_integral=10.0)
    contenders: list[tuple[str, control.AbstractController, Any, str]] = [
        ("null, $k_{max}$", control.ConstantStiffness(paper.STIFF), {}, QUIET),
        ("PID tuned at I", pid, {}, ESTIMATE),
        ("bang-bang position, tuned at I", bang, {}, OTHER),
        ("law (23), instant actuator", paper.CONTROLLERS["law"], {"sensor": None}, TRUTH),
    ]
    later = [
        ("PID retuned at 2I", retuned, {}, _GREEN),
        ("PID with Ki at 0.75 of its limit at I", eager, {}, _PINK),
    ]
    pictures = []
    for number, inertia, shown in ((4, paper.INERTIA, contenders), (5, 2 * paper.INERTIA, [*contenders, *later])):
        figure, axis = new_figure(7.5, 4.0)
        for label, controller, options, colour in shown:
            motion = paper.motion_of(position_loop(controller, inertia, **options))
            axis.plot(motion.time, motion.positions[0], color=colour, label=label)
        axis.axhspan(-paper.BAND, paper.BAND, color=QUIET, alpha=0.5, linewidth=0)
        axis.set(xlabel="time after the impact [s]", ylabel="position [rad]", xlim=(0, 2.5), ylim=(-0.6, 0.6))
        axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=3, fontsize=8)
        times = "I" if number == 4 else "2I"
        figure.suptitle(f"Fig. {number}: inertia {times}; impulse 0.02 N·m·s, motor 30 ms and 6 rad/s (assumed)")
        pictures.append(save(figure, folder / f"fig{number}_comparison.png"))
    return pictures


def _draw_thresholds(folder: Path) -> Path:
    """Fig. 6: law (23), fixed thresholds and the conic rule with an actuator of 0.1 s."""
    (a, c), *_ = paper.tuned_conic()
    rules = {
        "law (23)": control.Conic(),
        "fixed thresholds of 0.0594 rad, 0.743 rad/s": control.FixedThresholds(0.0594, 0.743),
        f"conic, a = {a:.3g} s, c = {c:.3g} 1/s": control.Conic(a, c),
    }
    figure, axes = new_figure(9.5, 5.2, 2, len(rules), sharex=True, sharey="row", height_ratios=(2, 1))
    for column, (label, rule) in zip(axes.T, rules.items(), strict=True):
        controller = control.StiffnessSwitch(paper.SOFT, paper.STIFF, rule)
        motion = paper.motion_of(paper.link_loop(controller, travel=paper.TRAVEL))
        column[0].plot(motion.time, motion.positions[0], color=TRUTH)
        column[0].axhspan(-paper.BAND, paper.BAND, color=QUIET, alpha=0.5, linewidth=0)
        column[0].set_title(label, fontsize=8)
        column[1].plot(motion.time, motion.commanded[0], color=QUIET, linewidth=1, label="commanded")
        column[1].plot(motion.time, motion.stiffness[0], color=OTHER, label="of the spring")
        column[1].set(xlabel="time [s]", xlim=(0, 2.2))
    axes[0, 0].set_ylabel("position [rad]")
    axes[1, 0].set_ylabel("stiffness\n[N·m/rad]")
    axes[1, 2].legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    figure.suptitle("Fig. 6: an actuator that takes 0.1 s from end to end")
    return save(figure, folder / "fig6_anticipation.png")


def _draw_arm(folder: Path) -> list[Path]:
    """Figs. 7 and 8: the arm under the law, and at constant stiffness."""
    pictures = []
    for number, names in ((7, ("law",)), (8, ("stiff", "soft"))):
        figure, axes = new_figure(7.5, 4.6, 2, sharex=True)
        for name in names:
            motion = paper.motion_of(paper.arm_loop(paper.CONTROLLERS[name]))
            settled = paper.arm_settling(motion)
            for joint, axis in enumerate(axes):
                label = f"{_LABELS[name]}: {settled[joint]:.3f} s"
                axis.plot(motion.time, np.rad2deg(motion.positions[joint]), color=_COLOURS[name], label=label)
                axis.axvline(settled[joint], color=_COLOURS[name], linestyle=":")
        for joint, axis in enumerate(axes, start=1):
            axis.axhspan(-2, 2, color=QUIET, alpha=0.5, linewidth=0)
            axis.set_ylabel(f"joint {joint} [deg]")
            axis.legend(loc="upper right", fontsize=8, title="within ±2° after", title_fontsize=8, **_OVER_LINES)
        axes[1].set(xlabel="time after the impact [s]", xlim=(0, 1.6 if number == 7 else 7.0))
        figure.suptitle(f"Fig. {number}: arm of two links, 0.10 N·s across the tip, k from 0.3 to 1 N·m/rad")
        pictures.append(save(figure, folder / f"fig{number}_arm.png"))
    return pictures


def _draw_optimum(folder: Path) -> Path:
    """The law's cost over the optimum's against the end time, for three costs, without friction."""
    free = switching.exact_motion(
        paper.oscillator(0.0), jnp.asarray(paper.SOFT), jnp.asarray(paper.STIFF), impulse=paper.INERTIA
    )
    switches = np.asarray(free.switch_times)
    # The ratios are 1 at switches, between sharp rises.
    times = np.unique(np.concatenate([np.linspace(0.03, 1.2, 91), switches[switches < 1.2]]))
    figure, axis = new_figure(8.0, 3.8)
    for (label, cost), colour in zip(paper.optimal_costs().items(), (OTHER, ESTIMATE, _GREEN), strict=True):
        axis.semilogy(times, paper.law_over_optimum(times, cost), color=colour, label=label)
    for switch in switches[switches < 1.2]:
        axis.axvline(switch, color=QUIET, linewidth=0.6)
    axis.set(xlabel="end time T [s]", ylabel="cost of law (23) over the least", xlim=(0, 1.2))
    axis.legend(title="cost at T", loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8)
    figure.suptitle("Law (23) is an extremal, not the optimum (no friction; grey: its switches)")
    return save(figure, folder / "optimum.png")


def _draw_slew(folder: Path) -> Path:
    """Mean settling time against the actuator's travel time, for law, lead, conic and smooth law."""
    (a, c), *_ = paper.tuned_conic()
    travels = np.array([0.002, 0.005, 0.01, 0.02, 0.03, 0.05, 0.075, 0.1, 0.15, 0.2])

    def switch(rule: control.AbstractRule) -> control.StiffnessSwitch:
        return control.StiffnessSwitch(paper.SOFT, paper.STIFF, rule)

    def smooth(sharpness: float) -> control.SmoothStiffness:
        return control.SmoothStiffness(paper.SOFT, paper.STIFF, sharpness, paper.RATE)

    curves = {
        "law (23)": (switch(control.Conic()), TRUTH),
        "time-lead of 0.05 s": (switch(control.TimeLead(0.05, 0.05)), ESTIMATE),
        "conic, tuned at 0.1 s": (switch(control.Conic(a, c)), OTHER),
        "smooth, β = 5": (smooth(5.0), _GREEN),
        "smooth, β = 1.3": (smooth(1.3), _PINK),
    }
    figure, axis = new_figure(8.0, 4.0)
    lanes = np.array([(j, paper.INERTIA, t) for t in travels for j in paper.IMPULSES])
    for label, (controller, colour) in curves.items():
        loop = paper.link_loop(controller, travel=0.1)
        settled = paper.scores_over(loop, _blow_and_travel, lanes).settling_time
        means = np.asarray(settled).reshape(len(travels), -1).mean(axis=1)
        axis.semilogx(1e3 * travels, means, "o-", color=colour, label=label)
    axis.axvline(1e3 * paper.TRAVEL, color=QUIET, linestyle=":", zorder=0)
    axis.set_xticks([2, 5, 10, 20, 50, 100, 200], labels=["2", "5", "10", "20", "50", "100", "200"])
    axis.set_xticks([], minor=True)
    axis.set(
        xlabel="actuator's travel time, end to end [ms] (dotted: the qbmove)", ylabel="mean settling time [s]"
    )
    axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8)
    figure.suptitle("What a slow actuator costs, and what anticipation gives back (21 impulses)")
    return save(figure, folder / "slew.png")


def _blow_and_travel(loop: ControlLoop) -> list[Any]:
    return [*paper.blow_of(loop), loop.plant.actuator.travel_time]


def _draw_conic(folder: Path) -> Path:
    """The mean log-energy over lead and slope of the conic rule at an actuator of 0.1 s."""
    (a, c), leads, slopes, energy = paper.tuned_conic()
    figure, axis = new_figure(6.0, 4.2)
    shown = axis.contourf(1e3 * leads, slopes, energy.T, levels=24, cmap="viridis_r")
    figure.colorbar(shown, label="mean log-energy")
    axis.plot(1e3 * a, c, "*", color=OTHER, markersize=14, label=f"best: {1e3 * a:.3g} ms, {c:.3g} 1/s")
    axis.plot(0, 0, "o", color=TRUTH, markeredgecolor="white", clip_on=False, zorder=5, label="law (23)")
    axis.set(xlabel="lead a [ms]", ylabel="slope c [1/s]")
    axis.legend(loc="upper right", facecolor="white", frameon=True, fontsize=8)
    figure.suptitle("Conic rule, actuator 0.1 s")
    return save(figure, folder / "conic.png")
