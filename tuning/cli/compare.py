"""Comparing configurations on the same scenarios: those of given files, or the best of every option of a study."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tuning.terminal.following import words
from tuning.terminal.options import (
    JSON,
    QUIET,
    RESUME,
    RUN,
    SEED,
    SETTINGS,
    STUDY,
    between,
    emit,
    table,
    with_seed,
    with_trials,
)

if TYPE_CHECKING:
    from tuning.scoring.comparison import Contender
    from tuning.study.base import Study


@click.command(epilog="Example: vsajax contest shipped:contests/damping -o runs/contest")
@STUDY
@RUN
@click.option(
    "--method", type=click.Choice(["cmaes", "tpe"]), default="cmaes", show_default=True, help="Of every search."
)
@with_trials("Of every contestant's search.", least_batch=4)
@SETTINGS
@SEED
@RESUME
@JSON
@QUIET
def contest(
    study: Path,
    folder: Path,
    method: Any,
    trials: int,
    batch: int,
    settings: tuple[str, ...],
    seed: int | None,
    resume: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Tune every option of STUDY's choices by as many trials, and compare them on held-out scenarios.

    The one that is best on the training scenarios is what the others are paired with.
    """
    from tuning.study.loading import load_study

    loaded = load_study(study, with_seed(settings, seed))
    from tuning.runs.machine import start_jax
    from tuning.scoring.needs import of_base, of_held_out, of_trials
    from tuning.study.choices import combinations
    from tuning.study.limits import require

    count = len(combinations(loaded.tune.choices))
    require(
        *of_base(loaded, str(study)),
        of_trials(loaded, trials, batch, "--trials and --batch", searches=count),
        of_held_out(loaded, count, f"{study}: scenarios.held_out"),
    )
    start_jax()
    from tuning.search.contest import contest as hold_contest

    entrants = hold_contest(
        loaded,
        folder,
        method=method,
        trials=trials,
        batch=batch,
        resume=resume,
        quiet=quiet,
        place=str(study),
    )
    found = {entrant.name: entrant.judged for entrant in entrants if entrant.judged is not None}
    rows, lines, picture = _compared(loaded, list(found.values()), list(found), folder / "compare")
    for row, entrant in zip(rows, entrants, strict=True):
        row |= {"config": entrant.name, "best": entrant.path, "values": entrant.values, "train": entrant.train}
    emit(
        {"run": folder, "compare": folder / "compare", "picture": picture, "configs": rows},
        as_json=as_json,
        quiet=quiet,
        text=lambda: f"{lines()}\nwrote {folder}/*/best.toml, {folder / 'compare'} and {picture}",
        following=words("report", folder),
    )


@click.command(epilog="Example: vsajax compare a.toml runs/t/best.toml -s study.toml -o runs/duel")
@click.argument("configs", type=click.Path(path_type=Path), nargs=-1, required=True)
@click.option(
    "-s", "--study", type=click.Path(path_type=Path), required=True, help="Joint, excitation, noise, scores."
)
@RUN
@click.option("--scenarios", type=click.IntRange(min=2), help="Held-out noise draws.")
@SETTINGS
@SEED
@RESUME
@JSON
@QUIET
def compare(
    configs: tuple[Path, ...],
    study: Path,
    folder: Path,
    scenarios: int | None,
    settings: tuple[str, ...],
    seed: int | None,
    resume: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Score the estimators of CONFIGS on the same scenarios of one study, paired with the first of them."""
    from tuning.scoring.comparison import compare as run_comparison
    from tuning.scoring.comparison import contenders
    from tuning.study.loading import load_config, load_study

    own = [*settings, *([] if scenarios is None else [f"scenarios.held_out={scenarios}"])]
    twice = [str(path) for n, path in enumerate(configs) if path in configs[:n]]
    if twice:
        raise click.UsageError(f"{twice[0]} is named twice: a configuration is compared with others")
    loaded = load_study(study, with_seed(own, seed))
    studies = contenders({str(path): load_config(path) for path in configs}, loaded, str(study))
    from tuning.runs.machine import start_jax
    from tuning.scoring.needs import of_base, of_held_out
    from tuning.study.limits import require

    place = f"{study}: scenarios.held_out" if scenarios is None else "--scenarios"
    bases = [need for name, one in studies.items() for need in of_base(one, name)]
    require(*bases, of_held_out(loaded, len(studies), place))
    start_jax()
    found = run_comparison(studies, folder, resume=resume, quiet=quiet)
    rows, lines, picture = _compared(loaded, found, _labels(configs), folder)
    emit(
        {"run": folder, "picture": picture, "configs": rows},
        as_json=as_json,
        quiet=quiet,
        text=lambda: f"{lines()}\nwrote {folder / 'results.parquet'} and {picture}",
        following=words("report", folder),
    )


def _compared(
    study: Study, found: Sequence[Contender], labels: Sequence[str], folder: Path
) -> tuple[list[dict[str, Any]], Callable[[], str], Path]:
    """Return rows of a comparison for machines, the same as text for people, and its picture in a run folder."""
    from tuning.pictures.style import save
    from tuning.report.pictures.searches import draw_tuning
    from tuning.study.scores import unit_of

    objective = study.tune.objective
    each = dict(zip(labels, (contender.judgement.each for contender in found), strict=True))
    picture = save(draw_tuning(each, objective), folder / "figures" / "compare.png")
    rows = [
        {
            "config": contender.name,
            **contender.judgement.summary(),
            "difference": contender.difference,
            "difference_low": contender.low,
            "difference_high": contender.high,
            "wins": contender.wins,
            "ties": contender.ties,
            "verdict": contender.verdict if i else "first",
        }
        for i, contender in enumerate(found)
    ]

    def text() -> str:
        headers = [
            "config",
            f"{study.tune.statistic.label} {objective}{unit_of(objective)}",
            "95 %",
            "median",
            "minus first",
            "95 %",
            "than the first",
        ]
        lines = [
            [
                c.name,
                c.judgement.value,
                between(c.judgement.low, c.judgement.high) or "–",
                c.judgement.median,
                c.difference,
                (between(c.low, c.high) if i else "") or "–",
                _against_first(c) if i else "–",
            ]
            for i, c in enumerate(found)
        ]
        tied = [c.name for c in found[1:] if c.verdict in {"tie", "equal"}]
        said = [f"no difference is shown from the first: {', '.join(tied)}"] if tied else []
        return "\n".join([table(headers, lines), *said])

    return rows, text, picture


def _against_first(contender: Contender) -> str:
    """Return what the paired scores say of a configuration against the first."""
    if contender.verdict == "equal":
        return f"equal to rounding in all of {contender.judgement.scenarios}"
    if contender.verdict == "no interval":
        return "one scenario: no interval"
    share = f"better in {100 * contender.wins:.0f} % of {contender.judgement.scenarios}"
    share += f", equal in {100 * contender.ties:.0f} %" if contender.ties else ""
    return f"{'a tie' if contender.verdict == 'tie' else contender.verdict}; {share}"


def _labels(paths: tuple[Path, ...]) -> list[str]:
    """Return the files' names where they tell them apart, else the last two parts of their paths."""
    names = [path.stem for path in paths]
    return names if len(set(names)) == len(names) else ["/".join(path.parts[-2:]) for path in paths]
