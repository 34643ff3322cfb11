"""What the plan of each command needs, from the numbers of its study alone; nothing here imports jax.

Memory is what was seen to be held a sample, a row or a lane. Times are right to a factor of about three on a
desktop's cores: they tell minutes from months, and `--dry-run` measures.
"""

from __future__ import annotations

import math
from dataclasses import replace

from tuning.files.errors import input_error
from tuning.runs.machine import usable_cores
from tuning.study.base import Config, Study, Timed
from tuning.study.kinds import kind_of
from tuning.study.limits import Need, Needs, in_count, product
from tuning.study.parts.estimators import AlgebraicObserver, AntagonisticPair, EstimatorTable
from tuning.study.ranges import Reach
from tuning.study.structures import grid_structures

_SAMPLE_BYTES, _SAMPLE_SECONDS = 600, 3e-5
"""Of one recording that is simulated, written and drawn."""
_GOLDEN_BYTES, _GOLDEN_SAMPLE_TIME = 4000, 1e-3
"""Of a sample of a golden recording, most of it text; and the sample time of what has none [s]."""
_LANE_BYTES, _MOTION_BYTES = 40, 160
"""Of a sample of one of the recordings that are scored side by side, and of its motion where that is its own."""
_LANES = 16
"""`vsajax.rollout.LANES_PER_CHUNK`: what a plan needs is told before jax is imported. A test holds them equal."""
_STEP_SECONDS, _TONE_SECONDS = 8e-8, 5e-9
"""Of a lane's sample on one core; each integration step of its motion takes about as long again."""
_SQUARE_SECONDS, _SQUARE_BYTES = 1.5e-10, 48
"""Of an entry of a covariance: a sample's work, and its copies."""
_CUBE_SECONDS = 9e-6
"""Of compiling a fit, whose features are a line of the program each: a minute for 190 of them."""
_DELAY_SECONDS = 0.1
"""Of compiling a sample that a controller's delay may hold back."""
_ROW_BYTES = 8 * 3
"""Of a number in a table that is joined, read and sorted."""
_ROW_COLUMNS = 16
"""Scores, status and numbers of a row, apart from what varies."""
_CHUNK_STEPS = 1e8
"""Samples of all lanes of a sweep's chunk."""
_TRIAL_BYTES, _TRIAL_SECONDS = 4000, 1e-6
"""Of a trial in a journal that is held whole; each trial looks at all that were before."""
_WORKER_BYTES = 400 * 2**20


def samples_of(study: Study) -> float:
    """Return the number of samples of a recording; it may be beyond all that integers of 64 bits hold.

    A log's is not known before it is read: one.
    """
    return study.clock.duration / study.clock.sample_time + 1.0 if isinstance(study, Timed) else 1.0


def of_fit(estimator: EstimatorTable, place: str, *, samples: float = 0.0) -> Need:
    """Return what an estimator needs over one recording."""
    size = estimator.size
    taps = 0.0
    sides = (estimator.side, estimator.other) if isinstance(estimator, AntagonisticPair) else (estimator,)
    for side in sides:
        if isinstance(side, AlgebraicObserver):
            taps = max(taps, (side.longest_window or side.window) / side.sample_time)
    amount = f"{in_count(size)} coefficients" + (
        f", a window of {in_count(round_up(taps))} samples" if taps else ""
    )
    return Need(
        f"{place}: estimator",
        amount,
        "lower the terms or the order of the basis" + (", or shorten longest_window" if taps else ""),
        memory=_SQUARE_BYTES * product(size, size) + 80.0 * taps + _SAMPLE_BYTES * samples,
        seconds=samples * (_SAMPLE_SECONDS + _SQUARE_SECONDS * product(size, size)),
        compiling=_CUBE_SECONDS * product(size, size, size),
    )


def of_recording(study: Timed, place: str) -> Need:
    """Return what one recording of a study needs."""
    samples, steps = samples_of(study), _integration_steps(study)
    set_steps = study.substeps_set() or 1
    substeps = f" × {in_count(set_steps)} integration steps" if set_steps > 1 else ""
    return Need(
        f"{place}: clock",
        f"{in_count(round_up(samples))} samples ({study.clock.duration:g} s, one every "
        f"{study.clock.sample_time:g} s){substeps}",
        "check the units, seconds, of clock.duration and clock.sample_time"
        + (", and substeps" if substeps else ""),
        memory=_SAMPLE_BYTES * samples + 48.0 * study.tones(),
        seconds=samples * (_SAMPLE_SECONDS + steps * _STEP_SECONDS + study.tones() * _TONE_SECONDS),
        compiling=_DELAY_SECONDS * product(study.longest_delay()),
    )


def needs_of(study: Study) -> Needs | None:
    """Return what plans of a kind take that runs over no samples; `None` of the others."""
    own = kind_of(study).needs
    return None if own is None else own.load()


def of_base(study: Study, place: str) -> list[Need]:
    """Return what every command that scores a study needs: one recording, and a compiled estimator."""
    found = [of_recording(study, place)] if isinstance(study, Timed) else []
    return [*found, of_fit(study.estimator, place)] if isinstance(study, Config) else found


def of_scores(
    study: Study,
    count: float,
    asked: Need,
    *,
    rows: float = 0.0,
    columns: float = 0.0,
    together: float = 0.0,
    machines: float = 1.0,
) -> Need:
    """Return what it takes to score recordings of a study.

    Args:
        study: the study.
        count: recordings.
        asked: what asks for them, and how to ask for fewer; its own memory and time are added.
        rows: of the table that is kept.
        columns: of the table, beside the scores.
        together: scores that one program returns.
        machines: like this one, that share the work.
    """
    table = _ROW_BYTES * product(rows, _ROW_COLUMNS + columns) + 8.0 * product(together, _ROW_COLUMNS)
    lanes = min(count, _LANES * usable_cores())
    own = needs_of(study)
    if own is not None:
        memory, seconds = own.scenario
        return replace(
            asked,
            memory=asked.memory + lanes * memory + table,
            seconds=asked.seconds + product(count) * seconds / (usable_cores() * machines),
        )
    samples, size = samples_of(study), 0
    if isinstance(study, Config):
        size = study.estimator.size
    has_motion = isinstance(study, Timed) and study.has_own_motions()
    lane = (_LANE_BYTES + has_motion * _MOTION_BYTES) * samples + _SQUARE_BYTES * product(size, size)
    step = _STEP_SECONDS + _SQUARE_SECONDS * product(size, size)
    if has_motion:
        step += _STEP_SECONDS * _integration_steps(study)
    return replace(
        asked,
        memory=asked.memory + lanes * lane + table,
        seconds=asked.seconds + product(count, samples) * step / (usable_cores() * machines),
    )


def of_structures(study: Study, place: str) -> list[Need]:
    """Return what the estimator of every combination of settings that a study's grid varies needs."""
    studies = [one for chosen, one in grid_structures(study, f"{place}: sweep.grid") if chosen]
    return [of_fit(one.estimator, place) for one in studies if isinstance(one, Config)]


def of_sweep(study: Study, place: str, *, machines: float = 1.0) -> Need:
    """Return what the grid of a study needs; `place` is the file's, or that of the options in its place."""
    sizes = {path: axis.size for path, axis in study.sweep.grid.items()}
    scenarios, points = study.sweep.scenarios, product(*sizes.values())
    rows = product(points, scenarios)
    inner = product(
        scenarios, *(size for path, size in sizes.items() if Reach.REGRESSORS not in study.reach(path))
    )
    amount = f"{in_count(points)} points × {in_count(scenarios)} scenarios = {in_count(rows)} rows of results"
    asked = Need(place, amount, "give the axes fewer points, or fewer scenarios")
    chunk = max(inner, min(rows, _CHUNK_STEPS / samples_of(study)))
    return of_scores(study, rows, asked, rows=rows, columns=len(sizes), together=chunk, machines=machines)


def of_population(study: Study, scenarios: float, place: str, *, machines: float = 1.0) -> Need:
    """Return what a Monte Carlo run over a study's population needs."""
    asked = Need(place, f"{in_count(scenarios)} robots, a row of results each", "run fewer scenarios")
    columns = len(study.population.paths)
    return of_scores(study, scenarios, asked, rows=scenarios, columns=columns, machines=machines)


def of_design(study: Study, rows: float, place: str, *, machines: float = 1.0) -> Need:
    """Return what a design for Sobol indices needs, of so many rows."""
    paths, factors = len(study.population.paths), len(study.population.factors) + 1
    count = product(rows, factors + 2)
    amount = f"{in_count(rows)} rows of a design × {factors + 2} = {in_count(count)} robots"
    asked = Need(place, amount, "ask for fewer rows", memory=product(rows, 2 * max(paths, 1), 24))
    return of_scores(study, count, asked, rows=count, columns=paths, machines=machines)


def of_gradient(study: Study, place: str, *, screened: float | None = None, starts: float | None = None) -> Need:
    """Return what a search by the gradient needs, of the study's starts and points screened unless given."""
    tune, train = study.tune, study.scenarios.train
    points = max(tune.screen, tune.starts) if screened is None else screened
    begun = tune.starts if starts is None else starts
    steps = product(begun, tune.max_steps, len(tune.parameters) + 2)
    amount = (
        f"{in_count(points)} points screened and {in_count(begun)} starts of {in_count(tune.max_steps)} steps, "
        f"× {in_count(train)} training scenarios"
    )
    asked = Need(place, amount, "ask for fewer of these", memory=64.0 * product(points, len(tune.parameters) + 4))
    return of_scores(study, product(points + steps, train), asked, together=product(points, train))


def of_grid_search(study: Study, place: str, *, refines: bool) -> Need:
    """Return what a search over every combination of the bounds' points needs; it may go on by the gradient."""
    points = product(*(bounds.points for bounds in study.tune.parameters.values()))
    starts = study.tune.starts if refines else 0
    return replace(
        of_gradient(study, place, screened=points, starts=starts),
        fix="give the bounds fewer points, or tune fewer",
    )


def of_trials(study: Study, trials: float, batch: float, place: str, *, searches: float = 1.0) -> Need:
    """Return what black-box searches need, of so many trials each and so many of them at a time."""
    train = study.scenarios.train
    many = f"{in_count(searches)} searches of " if searches > 1 else ""
    amount = (
        f"{many}{in_count(trials)} trials, {in_count(batch)} at a time, × {in_count(train)} training scenarios"
    )
    # Every batch is a program of as many lanes, however many of them are asked for.
    count = product(searches, max(trials, batch))
    own = product(searches, trials, trials) * _TRIAL_SECONDS
    asked = Need(place, amount, "ask for fewer", memory=_TRIAL_BYTES * (trials + batch), seconds=own)
    return of_scores(study, product(count, train), asked, together=product(batch, train))


def of_held_out(study: Study, configurations: float, place: str) -> Need:
    """Return what it takes to judge configurations on the held-out scenarios."""
    held_out = study.scenarios.held_out
    amount = f"{in_count(configurations)} configurations × {in_count(held_out)} held-out scenarios"
    count = product(configurations, held_out)
    # Each is resampled for its interval.
    asked = Need(place, amount, "judge on fewer", memory=8.0 * 2000 * held_out if held_out > 1e6 else 0.0)
    return of_scores(study, count, asked, rows=count, together=held_out)


def of_study(study: Study, place: str) -> list[Need]:
    """Return what a study asks for by itself: its recording, its grid, its search by default, its judgement."""
    own = needs_of(study)
    found = of_base(study, place) if own is None else own.file(study, place)
    if study.sweep.grid:
        found += [*of_structures(study, place), of_sweep(study, f"{place}: sweep.grid")]
    if study.tune.parameters:
        found.append(of_gradient(study, f"{place}: tune"))
        found.append(of_held_out(study, 2, f"{place}: scenarios.held_out"))
    return found


def of_log(estimator: EstimatorTable, samples: float, place: str) -> Need:
    """Return what an estimator needs over a log that was read, with lanes side by side."""
    return replace(
        of_fit(estimator, place, samples=samples),
        place=place,
        amount=f"{in_count(samples)} samples",
        fix="cut the log, or have its map resample it",
        memory=(_SAMPLE_BYTES + _LANE_BYTES * _LANES * usable_cores()) * samples,
    )


def of_export(config: object, seconds: float, place: str, option: str) -> list[Need]:
    """Return what an export needs: its parts, and a golden recording of so many seconds that `option` asks for."""
    found, sample_time = [], _GOLDEN_SAMPLE_TIME
    if isinstance(config, Config):
        found.append(of_fit(config.estimator, place))
    if isinstance(config, Timed):
        sample_time = config.clock.sample_time
        recording = of_recording(config, place)
        found.append(replace(recording, memory=0.0, seconds=0.0))
    samples = seconds / sample_time
    amount = f"{in_count(round_up(samples))} samples of a golden recording ({seconds:g} s)"
    fix = "ask for a shorter one, in seconds"
    golden = Need(option, amount, fix, memory=_GOLDEN_BYTES * samples, seconds=5.0 * _SAMPLE_SECONDS * samples)
    return [*found, golden]


def of_workers(workers: float, place: str) -> Need:
    """Return what processes of this machine need."""
    return Need(place, f"{in_count(workers)} processes", "start fewer", memory=_WORKER_BYTES * float(workers))


def require_drawable(study: Study, scenarios: int, place: str) -> None:
    """Refuse scenarios beyond those that can be told apart: 2³⁰ Sobol points, 2³² draws of noise.

    Raises:
        InputError: names the largest number.
    """
    uses_sobol = study.population.sampling == "sobol" and bool(study.population.paths)
    most = 2**30 if uses_sobol else 2**32
    if scenarios > most:
        fix = 'choose a lower number, or population.sampling = "random"' if uses_sobol else "choose a lower number"
        problem = f"asks for the first {in_count(scenarios)} scenarios; there are {in_count(most)}"
        raise input_error(place, problem, fix)


def round_up(count: float) -> float:
    """Return the next whole number of a finite one, else the count."""
    return math.ceil(count - 1e-9) if math.isfinite(count) else count


def _integration_steps(study: Study) -> float:
    # Where the lab chooses them, one or two are enough for all joints that ship.
    return float(study.substeps_set() or 2) if isinstance(study, Timed) else 2.0
