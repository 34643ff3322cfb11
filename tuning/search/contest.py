"""Every structure of a study tuned on the same robots by the same number of trials, then compared on others.

RUN/<options>/best.toml   each structure tuned, with the run of its search
RUN/compare               the comparison of them on the held-out scenarios, the best on the training ones first
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from tuning.files.errors import input_error
from tuning.files.whole import write_text
from tuning.runs.folder import open_run
from tuning.scoring.comparison import Contender, compare, contenders
from tuning.search.blackbox import BlackBox, explore
from tuning.search.refine import Search
from tuning.study.base import Study, resolved, to_toml
from tuning.study.choices import Chosen
from tuning.study.loading import load_config
from tuning.study.structures import structures

Method = Literal["cmaes", "tpe"]


@dataclass(frozen=True)
class Entrant:
    """A structure of the contest, tuned.

    Args:
        name: its options.
        chosen: option by choice.
        values: the tuned numbers by path; empty where it has none.
        train: statistic of the objective over the training scenarios.
        path: its `best.toml`.
        judged: on the held-out scenarios, paired with the best of the training ones.
    """

    name: str
    chosen: Chosen
    values: dict[str, float]
    train: float
    path: Path
    judged: Contender | None = None


def contest(
    study: Study,
    folder: Path,
    *,
    method: Method = "cmaes",
    trials: int = 128,
    batch: int = 16,
    resume: bool = False,
    quiet: bool = False,
    place: str = "study",
) -> list[Entrant]:
    """Tune every structure, compare them, and return them, the best on the training scenarios first.

    CMA-ES needs two parameters: a structure with one is searched by TPE, and one without is judged as it is.

    Args:
        study: its choices are the contest.
        folder: the run folder.
        method: of the search.
        trials: of each structure.
        batch: trials at a time.
        resume: go on with what the folder holds.
        quiet: show no progress.
        place: source of the study in errors.

    Raises:
        InputError: there are fewer than two structures, or the folder holds another run.
    """
    found = structures(study, place)
    if len(found) < 2:
        fix = 'add some, e.g. [tune.choices.basis.lean] "estimator.basis.deflection_terms" = 2'
        raise input_error(f"{place}: tune.choices", "leave fewer than two contestants", fix)
    BlackBox(study, method, batch).build()
    plan = {"method": method, "batch": batch, "trials": trials}
    store = open_run(folder, "contest", study, plan, [], resume=resume)
    entrants = [_tune(chosen, own, store.folder, method, trials, batch, resume, quiet) for chosen, own in found]
    entrants.sort(key=lambda entrant: entrant.train)
    # Named by their files, from which `vsajax report` simulates them again.
    configs = {str(entrant.path): load_config(entrant.path) for entrant in entrants}
    judged = compare(contenders(configs, study, place), store.folder / "compare", resume=resume, quiet=quiet)
    return [replace(one, judged=by) for one, by in zip(entrants, judged, strict=True)]


def _tune(
    chosen: Chosen, study: Study, folder: Path, method: Method, trials: int, batch: int, resume: bool, quiet: bool
) -> Entrant:
    name = "-".join(chosen.values())
    path = folder / name / "best.toml"
    if not study.tune.parameters:
        judgement = Search(study, method).judge({}, "train", study.scenarios.train)
        write_text(path, to_toml(resolved(study)))
        return Entrant(name, chosen, {}, judgement.value, path)
    own: Method = method if len(study.tune.parameters) > 1 else "tpe"
    explored = explore(BlackBox(study, own, batch), path.parent, trials=trials, resume=resume, quiet=quiet)
    return Entrant(name, chosen, explored.best.values, explored.best.objective, path)
