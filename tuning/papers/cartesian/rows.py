"""Petit, Albu-Schäffer: Cartesian impedance control for a variable stiffness robot arm.

Table I at the instant t1, from a geometry fitted to the table (lengths and pose are not published), what its other
instants say, and the closed loop; random poses, better poses and loads are in `cartesian_space`. Corrections to
the printed equations are listed in `docs/cartesian.md`.
"""

from __future__ import annotations

from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from tuning.kinds.arm.bench import ArmBench
from tuning.papers.cartesian.space import load_rows, open_example, pose_rows, random_pose_rows
from tuning.papers.rows import Report, Row
from tuning.pictures.style import ESTIMATE, OTHER, TRUTH, new_figure, save
from vsajax import arm_loop, plants
from vsajax.arms import ArmBodies
from vsajax.control import ActiveSet, CartesianImpedance, StiffnessDesign, StiffnessDesigner, inverse

_TITLE = "Petit, Albu-Schäffer: Cartesian impedance control for a variable stiffness robot arm"
_JOINTS = (394.0, 123.0, 113.0, 161.0)
# Table I, upper triangles xx, xy, xz, yy, yz, zz.
_ENTRIES = ("xx", "xy", "xz", "yy", "yz", "zz")
_ACTIVE = (116.0, 5.0, 0.0, 97.0, 1.0, 4545.0)
_PASSIVE = {
    "t1": (922.0, -1695.0, 1.0, 8398.0, -8.0, 299.0),
    "t2": (925.0, -1705.0, -12.0, 8110.0, 65.0, 489.0),
    "t3": (879.0, 592.0, -1.0, 11092.0, 25.0, 324.0),
}
_SERIAL = {
    "t1": (96.0, 1.0, 0.0, 95.0, 0.0, 280.0),
    "t2": (96.0, 0.0, 0.0, 95.0, 1.0, 441.0),
    "t3": (102.0, 5.0, 0.0, 96.0, 0.0, 303.0),
}
_K_A_NOTE = (
    "cannot be the printed one: X = C_d − C_p ≤ C_d, so no eigenvalue of K_Ca lies below the least of K_d, 100; "
    "printed has 95.8. Judged against (13)–(14) with the geometry of t1"
)


def _problem(**changes: object) -> tuple[ArmBench, jax.Array]:
    problem, pose = open_example()
    designer = StiffnessDesigner(problem.designer.max_active_stiffness, **changes)  # pyright: ignore[reportArgumentType]
    return eqx.tree_at(lambda p: p.designer, problem, designer), pose


def _design(**changes: object) -> StiffnessDesign:
    problem, pose = _problem(**changes)
    return eqx.filter_jit(lambda p, q: p.design(q))(problem, pose)


def reproduce(folder: Path | None) -> Report:
    """Compute the rows, and draw the figure into `folder` unless it is `None`."""
    plain, printed, exact = (_design(scaling=name) for name in ("none", "printed", "exact"))
    paper = _design(scaling="none", solver=ActiveSet("drop_first"))
    sweeps = _sweeps()
    rows = [*_table_rows(plain, paper), *_consistency_rows(), *_scaling_rows(printed, exact)]
    rows += [*random_pose_rows(), *pose_rows(), *load_rows(), *_loop_rows(sweeps)]
    figures = [] if folder is None else [_draw(sweeps, folder)]
    return Report(_TITLE, rows, figures, _findings(plain))


def _symmetric(entries: tuple[float, ...]) -> np.ndarray:
    xx, xy, xz, yy, yz, zz = entries
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _near(
    name: str, printed: float | None, measured: float, unit: str, value: float, by: float, note: str = ""
) -> Row:
    return Row(name, printed, measured, unit, value - by, value + by, note)


def _upper(matrix: jax.Array) -> list[float]:
    return [float(matrix[i, j]) for i, j in zip(*np.triu_indices(3), strict=True)]


def _table_rows(design: StiffnessDesign, paper: StiffnessDesign) -> list[Row]:
    rows = [
        _near(f"k_Jp, joint {i + 1}", value, float(design.joint_stiffness[i]), "N·m/rad", value, 0.5)
        for i, value in enumerate(_JOINTS)
    ]
    # Of the smallest entries the fitted geometry leaves half a unit more than rounding.
    for name, printed, ours in zip(_ENTRIES, _PASSIVE["t1"], _upper(design.passive_stiffness), strict=True):
        rows.append(_near(f"K_Cp {name} at t1", printed, ours, "N/m", printed, 0.55))
    theory = (121.02, 4.29, 2.00, 102.08, 1.84, 4545.0)
    for name, printed, value, ours in zip(_ENTRIES, _ACTIVE, theory, _upper(design.active_stiffness), strict=True):
        rows.append(_near(f"K_Ca {name}", printed, ours, "N/m", value, 0.01, _K_A_NOTE))
    serial = (100.0, 0.0, 0.0, 100.0, 0.0, 280.536)
    note = "printed follows from printed K_Ca, see there; judged against (6) with ours"
    for name, printed, value, ours in zip(
        _ENTRIES, _SERIAL["t1"], serial, _upper(design.serial_stiffness), strict=True
    ):
        rows.append(_near(f"K_Cs {name} at t1", printed, ours, "N/m", value, 0.01, note))
    apart = float(jnp.abs(paper.joint_stiffness / design.joint_stiffness - 1.0).max())
    rows.append(Row("printed active set against interior point", None, apart, "relative", 0.0, 1e-9))
    return rows


def _consistency_rows() -> list[Row]:
    """Return whether (6) with printed K_Ca and K_Cp gives printed K_Cs: then the error is in K_Ca's making."""
    active = np.linalg.inv(_symmetric(_ACTIVE))
    rows = []
    for time, passive in _PASSIVE.items():
        serial = np.linalg.inv(active + np.linalg.inv(_symmetric(passive)))
        apart = float(np.abs(serial - _symmetric(_SERIAL[time])).max())
        note = "rounding of the printed entries allows 0.7"
        name = f"(6) from printed K_Ca, K_Cp against printed K_Cs, {time}"
        rows.append(Row(name, None, apart, "N/m", 0.0, 0.7, note))
    least = float(np.linalg.eigvalsh(_symmetric(_ACTIVE))[0])
    rows.append(_near("least eigenvalue of printed K_Ca", None, least, "N/m", 95.75, 0.75, _K_A_NOTE))
    return rows


def _scaling_rows(printed: StiffnessDesign, exact: StiffnessDesign) -> list[Row]:
    wanted = np.diag([100.0, 100.0, 300.0])
    off = float(np.abs(np.asarray(exact.serial_stiffness) - wanted).max() / 300.0)
    note = "(18) puts an eigenvalue of C_a at 0, which becomes 0⁺: an offset stays"
    shown = float(printed.serial_stiffness[2, 2])
    rows = [
        _near("K_Cs zz, scaled by (18)", None, shown, "N/m", 281.424, 0.01, note),
        Row("K_Cs against K_d, scaled by 1/λ_max(C_p, C_d − 0⁺I)", None, off, "relative", 0.0, 1e-10),
    ]
    return rows


_FORCES = {"x": 15.0, "z": 20.0}


def _sweeps() -> dict[str, tuple[np.ndarray, arm_loop.Equilibrium]]:
    """Return forces and equilibria of the arm without gravity, progressive springs, along x and z."""
    problem, pose = _problem(scaling="none")
    design = eqx.filter_jit(lambda p, q: p.design(q))(problem, pose)
    bodies = ArmBodies(np.zeros(4), np.zeros((4, 3)), np.zeros((4, 3, 3)))
    plant = plants.CompliantArm(problem.arm, bodies, plants.PresetSpring(0.05), design.joint_stiffness)
    controller = CartesianImpedance(problem.arm, design.active_stiffness, pose)
    loop = arm_loop.ArmLoop.at(plant, controller, pose, view="motor")
    run = eqx.filter_jit(arm_loop.equilibria)
    found = {}
    for axis, largest in _FORCES.items():
        forces = np.linspace(0.0, largest, 21)
        found[axis] = forces, run(loop, pose, jnp.asarray(forces[:, None] * np.eye(3)["xyz".index(axis)]))
    return found


def _loop_rows(sweeps: dict[str, tuple[np.ndarray, arm_loop.Equilibrium]]) -> list[Row]:
    first = sweeps["z"][1]
    off = float(jnp.abs(first.stiffness[0] - first.predicted[0]).max())
    note = "dF/dx of the closed loop of motors, springs and controller, by its derivative"
    rows = [Row("closed loop, dF/dx at rest against K_Cs", None, off, "N/m", 0.0, 1e-6, note)]
    reference = {"x": (151.0, 82.0), "z": (58.0, 7.6)}
    for axis, (length, share) in reference.items():
        forces, found = sweeps[axis]
        i = "xyz".index(axis)
        note = "of an independent reproduction; progression 0.05 rad, posture 20 N·m/rad, both our choice"
        moved = 1e3 * float(found.hand[-1, i])
        rows.append(
            _near(f"hand under {forces[-1]:g} N along {axis}", None, moved, "mm", length, 0.01 * length, note)
        )
        motors = 100.0 * float(found.motor_hand[-1, i] / found.hand[-1, i])
        rows.append(_near(f"share of the motors, {axis}", None, motors, "%", share, 0.02 * share, note))
    return rows


def _findings(design: StiffnessDesign) -> list[str]:
    ours = np.linalg.eigvalsh(np.asarray(inverse(design.active)))
    return [
        "K_Ca: the printed matrix is softer than any that (13)–(14) can give. Ours has the eigenvalues "
        + ", ".join(f"{value:.1f}" for value in ours)
        + " N/m, none below 100; printed K_Cs follows from printed K_Ca by (6), so the table is consistent "
        "with itself, and the 4–5 % lie in how K_Ca was measured or computed, which the paper does not say.",
        "zz stays at 280 instead of 300 because every free joint has Jᵢᵀ(C_d − C_p)Jᵢ = 0 at the optimum of (9): "
        "C_d − C_p is never positive definite while a joint is off its bounds. The offset is structural; scaling "
        "removes it.",
    ]


def _draw(sweeps: dict[str, tuple[np.ndarray, arm_loop.Equilibrium]], folder: Path) -> Path:
    figure, axes = new_figure(9.6, 3.6, 1, 2)
    for axis, (name, (forces, found)) in zip(axes, sweeps.items(), strict=True):
        i = "xyz".index(name)
        hand = 1e3 * np.asarray(found.hand[:, i])
        axis.plot(hand, forces, color=ESTIMATE, label="hand")
        axis.plot(1e3 * np.asarray(found.motor_hand[:, i]), forces, color=OTHER, label="motors' share")
        axis.plot(
            hand, float(found.stiffness[0, i, i]) * 1e-3 * hand, "--", color=TRUTH, label="stiffness at rest"
        )
        axis.set(xlabel=f"displacement along {name} [mm]", ylabel=f"force along {name} [N]")
        axis.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, fontsize=8)
    return save(figure, folder / "closed_loop.png")
