"""The kinds of study: what each of them consists of, by name. No kind is imported here before it is asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from tuning.files.errors import Mistake, input_error
from tuning.files.kinds import ARM_STUDY, CONFIG, LOG_STUDY, STUDY, FileKind
from tuning.study.plugins import Origin, Refused, Unknown
from tuning.study.refs import Ref
from tuning.study.registry import Registry

if TYPE_CHECKING:
    from tuning.study.base import Base

Tables = Mapping[str, Any]


@dataclass(frozen=True)
class Kind:
    """One kind of study.

    Args:
        name: as `kind = "NAME"` has it.
        file: what a file of this kind is.
        tables: its class, a `study.base.Base`; it does not import jax.
        problem: its `problem.interface.Problem`, called with the study and the paths that vary; `None` where
            nothing is scored over scenarios.
        picture: called with `(time,)` columns by name and a title, it returns the figure of one scenario.
        traces: what a report shows over time, called as `kinds.estimation.traces.show_estimates` is; `None` where
            there is nothing.
        finding: called with a study and the best that a search has found, it returns a `problem.finding.Finding`:
            what there is to say of it beyond scores; `None` where there is nothing.
        calibration: called with a study at the numbers that a search has found, it returns those by path that make
            its answers hold what they say; `None` where they say nothing of how sure they are.
        told: called with a study and the columns of its Monte Carlo run, it returns the `scoring.told.Told` that
            is said of it; `None` where quantiles over all robots are.
        page: called with the run folder of a command of its own, it returns the report; `None` where it has none.
        needs: its `study.limits.Needs`; `None` where what a scenario takes follows from its samples.
        deployable: called with a configuration and its place in errors, it returns the `exports.deployable` that
            leaves the lab; `None` where nothing does.
        holds: whether tables are of this kind; by default those whose `kind` is its name.
        edition: of its answers, counted up when the same study comes to answer otherwise: a run that was begun
            with an earlier one does not go on with this one.
    """

    name: str
    file: FileKind
    tables: Ref
    problem: Ref | None = None
    picture: Ref | None = None
    traces: Ref | None = None
    finding: Ref | None = None
    calibration: Ref | None = None
    told: Ref | None = None
    page: Ref | None = None
    needs: Ref | None = None
    deployable: Ref | None = None
    holds: Callable[[Tables], bool] | None = None
    edition: int = 1

    def is_of(self, tables: Tables) -> bool:
        """Return whether tables are of this kind."""
        return self.holds(tables) if self.holds is not None else tables.get("kind") == self.name


_ESTIMATES = 2
"""Edition of all that estimates: 2 since bands are those of batch means and features are as late as the torque."""


def _estimation(name: str, tables: str) -> Kind:
    return Kind(
        name,
        STUDY,
        Ref(f"tuning.kinds.estimation.study:{tables}"),
        problem=Ref("tuning.kinds.estimation.problem:EstimationProblem"),
        picture=Ref("tuning.kinds.estimation.pictures:draw_recording"),
        traces=Ref("tuning.kinds.estimation.traces:show_estimates"),
        calibration=Ref("tuning.kinds.estimation.calibration:calibrate"),
        deployable=Ref("tuning.kinds.estimation.deployable:deployable_of"),
        edition=_ESTIMATES,
    )


_OWN = (
    Kind(
        "log",
        LOG_STUDY,
        Ref("tuning.kinds.log.study:LogStudy"),
        problem=Ref("tuning.kinds.log.problem:LogProblem"),
        traces=Ref("tuning.kinds.log.traces:show_agreement"),
        finding=Ref("tuning.kinds.log.agreement:find_agreement"),
        holds=lambda tables: "recording" in tables,
        edition=_ESTIMATES,
    ),
    _estimation("serial", "SerialStudy"),
    _estimation("sea", "SeaStudy"),
    _estimation("antagonistic", "AntagonisticStudy"),
    Kind(
        "damping",
        STUDY,
        Ref("tuning.kinds.damping.study:DampingStudy"),
        problem=Ref("tuning.kinds.damping.problem:DampingProblem"),
        picture=Ref("tuning.kinds.damping.pictures:draw_swing"),
        traces=Ref("tuning.kinds.damping.traces:show_swings"),
        deployable=Ref("tuning.kinds.damping.deployable:deployable_of"),
    ),
    Kind(
        "arm",
        ARM_STUDY,
        Ref("tuning.kinds.arm.study:ArmStudy"),
        problem=Ref("tuning.kinds.arm.problem:ArmProblem"),
        told=Ref("tuning.kinds.arm.accuracy:Accuracy"),
        page=Ref("tuning.kinds.arm.page:report_folder"),
        needs=Ref("tuning.kinds.arm.needs:NEEDS"),
        deployable=Ref("tuning.kinds.arm.deployable:deployable_of"),
    ),
)


class Kinds(Registry[Kind]):
    """The kinds of study by name."""

    def fitted(self, tag: str, entry: Any, origin: Origin | None) -> Kind:
        """Return a foreign kind under the name by which a file asks for it."""
        if not isinstance(entry, Kind):
            raise Refused(f"got {tag!r}, which leads to {entry!r:.80}", f"a kind is a {Kind.__module__}:Kind")
        return replace(entry, name=tag, holds=None)


KINDS = Kinds("kinds", {kind.name: kind for kind in _OWN})


def all_kinds() -> Iterator[Kind]:
    """Return every kind that is here, in the order in which they are asked whether tables are theirs."""
    yield from KINDS.entries().values()


def kind_named(name: str) -> Kind:
    """Return a kind by its name.

    Raises:
        KeyError: there is none of that name.
    """
    try:
        return KINDS.find(name)
    except Refused:
        raise KeyError(name) from None


def kind_of(study: Base) -> Kind:
    """Return the kind that a study, or an estimator alone, is of; `kind` is that of its joint, also in a log's."""
    return next(kind for kind in all_kinds() if kind.is_of(vars(study)))


def lacking(place: str, study: Base, what: str, fix: str = "") -> Mistake:
    """Return the mistake of asking a study for what its kind does not have.

    Args:
        place: the study's file.
        study: of that kind.
        what: that it does not have, and why in brackets.
        fix: the way out; by default the commands that take such a file.
    """
    kind = kind_of(study)
    return Mistake(place, f"kind {kind.name!r} has no {what}", fix or kind.file.use.format(file=place))


def kind_in(tables: Tables, place: str, file: FileKind) -> Kind:
    """Return which kind of study tables are.

    Args:
        tables: of a file.
        place: their source, for errors.
        file: what the file is; only its kinds are allowed.

    Raises:
        InputError: their `kind` is missing, or is none of these.
    """
    allowed = [kind for kind in all_kinds() if kind.file is file]
    found = next((kind for kind in allowed if kind.is_of(tables)), None)
    if found is None:
        return _foreign_kind(tables, place, file, f"allowed: {', '.join(kind.name for kind in allowed)}")
    return found


def _foreign_kind(tables: Tables, place: str, file: FileKind, fix: str) -> Kind:
    """Return the kind that none of those here is, but that somebody else may have."""
    where, name = f"{place}: kind", tables.get("kind")
    got = f"got {name!r}" if "kind" in tables else "is missing"
    if not isinstance(name, str) or name in KINDS:
        raise input_error(where, got, fix)
    try:
        found = KINDS.find(name)
    except Unknown:
        raise input_error(where, got, f"{fix}; `vsajax parts kinds` lists them all") from None
    except Refused as refused:
        raise input_error(where, refused.problem, refused.fix) from None
    if found.file is not file:
        raise input_error(where, got, fix)
    return found


def study_files() -> list[FileKind]:
    """Return the kinds of file that hold a study of something that is scored."""
    return list(dict.fromkeys([STUDY, *(kind.file for kind in all_kinds() if kind.problem is not None)]))


def exported_files() -> list[FileKind]:
    """Return the kinds of file that can be exported."""
    return list(dict.fromkeys([CONFIG, *(kind.file for kind in all_kinds() if kind.deployable is not None)]))
