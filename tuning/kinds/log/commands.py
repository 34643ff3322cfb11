"""Tuning on a robot's own log: what `vsajax tune` does with a study that has a [recording]."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from tuning.files.errors import printable
from tuning.terminal.following import Words, words
from tuning.terminal.options import emit, table


def tune_log(study: Path, settings: Sequence[str], folder: Path, *, as_json: bool, quiet: bool) -> None:
    """Tune on the log of a study, print and write what was found."""
    from tuning.kinds.log.study import load_log_study, require_untouched

    loaded = load_log_study(study, settings)
    require_untouched(folder)
    from tuning.kinds.needs import of_fit, of_log_search
    from tuning.study.limits import require

    require(of_fit(loaded.estimator, str(study)), of_log_search(loaded, str(study)))
    from tuning.runs.machine import start_jax

    start_jax()
    from tuning.kinds.log.pictures import draw_tried
    from tuning.kinds.log.problem import plan_log_search, write_tuned_log
    from tuning.pictures.style import save

    search = plan_log_search(loaded, str(study))
    samples = len(search.table.columns["time"])
    require(
        of_fit(loaded.estimator, str(study), samples=samples), of_log_search(loaded, str(study), samples=samples)
    )
    tuned = search.run(quiet=quiet)
    write_tuned_log(loaded, tuned, folder)
    picture = save(draw_tried(tuned.rows, list(tuned.values)), folder / "figures" / "tuning.png")
    result = {name: value for name, value in asdict(tuned).items() if name != "rows"}
    result |= {"run": folder, "best": folder / "best.toml", "picture": picture, "notes": list(search.table.notes)}

    def text() -> str:
        parts = {"training": tuned.train, "held out": tuned.held_out, "whole log": tuned.whole}
        lines = [f"note: {printable(note)}" for note in search.table.notes]
        lines.append(table(["number", "tuned"], list(tuned.values.items())))
        lines.append(f"{loaded.tune.objective}: {tuned.before:.4g} % before, {tuned.objective:.4g} % tuned")
        if loaded.tune.objective == "agreement":
            headers = ["", "correlation", "without the lag", "stiffness [N·m/rad]", "samples"]
            rows = [[n, p.correlation, p.unlagged, p.stiffness, p.samples] for n, p in parts.items()]
        else:
            headers = ["", "rms [N·m]", "samples"]
            rows = [[n, p.rms, p.samples] for n, p in parts.items()]
        lines.append(table(headers, rows))
        if loaded.tune.objective == "no_load":
            lines.append(
                f"± {tuned.floor:.4g} N·m holds {100 * tuned.share_within:.4g} % of the held-out part's torque "
                "(and, being chosen so, 99.9 % of the training part's)"
            )
        return "\n".join([*lines, f"wrote {folder / 'best.toml'}, {folder / 'results.parquet'} and {picture}"])

    def following() -> Words:
        log = loaded.recording
        chosen = [word for column, value in log.select.items() for word in ("--select", f"{column}={value}")]
        mapped = [] if log.map is None else ["--map", log.map]
        return words("estimate", log.file, "-c", folder / "best.toml", *mapped, *chosen)

    emit(result, as_json=as_json, quiet=quiet, text=text, following=following)
