"""The report on a run of an arm."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tuning.kinds.arm.accuracy import Accuracy
from tuning.kinds.arm.figures import draw_pose
from tuning.kinds.arm.poses import draw_poses
from tuning.kinds.arm.run import ArmRun, read_run
from tuning.kinds.arm.workspace import draw_workspace
from tuning.pictures.page import Page, Picture, Table
from tuning.study.base import to_toml


def report_folder(folder: Path) -> Page:
    """Return the report on a run of one of an arm's own commands.

    Raises:
        InputError: a file of the run is missing, damaged, or another run's.
    """
    run = read_run(folder)
    headline, picture, tables = _DESCRIBE[run.command](run)
    manifest = run.manifest
    facts = [
        ["folder", str(run.folder)],
        ["command", f"vsajax {run.command}"],
        ["study", run.study.name],
        ["study hash", manifest["study_hash"]],
        ["seed", run.study.seed],
        ["versions", ", ".join(f"{name} {version}" for name, version in manifest["versions"].items())],
    ]
    return Page(
        title=f"{run.command}: {run.study.name}",
        headline=headline,
        pictures=[picture],
        tables=tables,
        provenance=Table("", [], facts),
        findings=[f"{sentence}." for sentence in run.result.get("outside", [])],
        sources=[("The full study", to_toml(manifest["study"]))],
    )


_Described = tuple[str, Picture, list[Table]]


def _percent(value: float | None) -> str:
    return "–" if value is None else f"{100.0 * value:.4g} %"


def _pose(run: ArmRun) -> _Described:
    result = run.result
    met = "met exactly" if result["is_exact"] else "not met exactly"
    headline = f"{_sentence(result['meaning'])}; the desired stiffness is {met}."
    joints = zip(result["joints"], result["pose"], result["joint_stiffness"], result["held"], strict=True)
    picture = Picture(
        "Joints and hand",
        draw_pose(run.study, result),
        "Left: the joints' stiffness within their bounds. Right: the stiffness of the hand by the direction of "
        "its displacement, in two planes; the controller (active) and the joints (passive) act in series.",
        headline,
    )
    errors = [[name.replace("_", " "), _percent(value)] for name, value in result["errors"].items()]
    rows = [[name, q, "–" if k is None else k, held] for name, q, k, held in joints]
    return (
        headline,
        picture,
        [
            Table("The joints", ["joint", "pose [rad]", "stiffness [N·m/rad]", "fit"], rows),
            Table("Relative errors of the hand's stiffness", ["error", ""], errors),
        ],
    )


def _workspace(run: ArmRun) -> _Described:
    result = run.result
    exact = f"The desired stiffness is met exactly in {_percent(result['exact_share'])} of {result['poses']} poses"
    headline = f"{exact}." if result["ok"] else f"No pose has a design that can be used: {result['meaning']}."
    picture = Picture(
        "The workspace",
        draw_workspace(run.study, dict(run.columns)),
        "By the place of the hand: the median of what the joints alone leave, and how often both together meet "
        "the desired stiffness exactly; right, how the errors are distributed over all poses.",
        headline,
    )
    quantiles = [[_words(name), *map(_percent, found.values())] for name, found in result["quantiles"].items()]
    statuses = [[_words(name), count] for name, count in result["statuses"].items() if count]
    return (
        headline,
        picture,
        [
            Table("Relative errors over all poses", ["error", "10 %", "median", "90 %"], quantiles),
            Table("What became of the designs", ["status", "poses"], statuses),
        ],
    )


def _poses(run: ArmRun) -> _Described:
    result = run.result
    medians: Mapping[str, Any] = result["median_error"]
    first, *_, last = medians.values()
    headline = (
        f"Median passive error over {result['targets']} targets: {_percent(first)} in their own poses, "
        f"{_percent(last)} after the search from {result['starts']} starts."
    )
    picture = Picture(
        "Errors of the targets",
        draw_poses(dict(run.columns)),
        "The share of targets whose error is below the value on the axis; further left is better.",
        headline,
    )
    rows = [[name, _percent(value)] for name, value in medians.items()]
    note = f"{result['unreached']} targets without a pose whose error has a value are left out."
    return (
        headline,
        picture,
        [Table("Median passive error", ["pose", ""], rows, note if result["unreached"] else "")],
    )


def _accuracy(run: ArmRun) -> _Described:
    """Describe a run from before Monte Carlo runs of arms went the way of all others."""
    told = Accuracy(run.study, run.columns)
    return told.headline, told.picture(), [told.table()]


def _words(name: str) -> str:
    return name.replace("_", " ")


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}"


_DESCRIBE = {"stiffness": _pose, "workspace": _workspace, "poses": _poses, "montecarlo": _accuracy}
