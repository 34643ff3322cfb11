"""A signal map proposed from the names and the numbers of a log's columns, each guess with its reason."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from tuning.files.errors import InputError, input_error, printable
from tuning.logs.columns import LogFile
from tuning.logs.faults import find_wraps
from tuning.logs.signal_map import PER_SECOND, Angle, Kind, name_need, signals_of, unmet_needs
from tuning.logs.streams import Log, open_log
from tuning.logs.units import unit_named

_TIME = r"^t_|^(t|time|times|timestamp|stamp|clock|elapsed|secs?|seconds|millis|micros)$|time|stamp"
_NOT_MEASURED = r"cmd|command|desired|target|\bref|reference|vel|speed|accel|err|temp|pwm|covariance|orientation"
# In order: a column is the first signal that it fits, a signal the first column that fits its first pattern.
_NAMES: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("setpoint_position", (r"set_?point.*pos|stiffness_?motor|theta_?c\b",)),
    ("motor1_position", (r"(motor|theta|m)_?1.*(pos|ang)|theta_?1\b",)),
    ("motor2_position", (r"(motor|theta|m)_?2.*(pos|ang)|theta_?2\b",)),
    ("motor1_torque", (r"(motor|tau|m)_?1.*(torq|tau|curr)|tau_?1\b",)),
    ("motor2_torque", (r"(motor|tau|m)_?2.*(torq|tau|curr)|tau_?2\b",)),
    ("true_stiffness", (r"true_stiff",)),
    ("true_elastic_torque", (r"true_(elastic_)?torq",)),
    ("deflection", (r"deflect|displac|spring_?(pos|ang)|twist", r"alpha")),
    ("motor_position", (r"(motor|rotor|hub).*(pos|ang|enc)", r"theta")),
    (
        "motor_torque",
        (r"(motor|rotor|phase).*(torq|tau|effort)", r"(motor|winding).*(curr|volt)|^current|^i_?q", r"vm\b|^volt"),
    ),
    ("link_position", (r"(link|joint|load|output|arm).*(pos|ang|enc)", r"^pos|position|^q\b|angle")),
    ("elastic_torque", (r"torque_?(ati|out|sens|meas)|elastic|effort", r"(ft|sensor|link).*torq", r"torq|tau")),
)
_UNITS: tuple[tuple[str, str], ...] = (
    (r"mrads?\b", "mrad"),
    (r"degs?\b|degrees?\b|°", "deg"),
    (r"rads?\b|radians?\b", "rad"),
    (r"counts?\b|cts\b|ticks?\b|raw\b|enc\b", "counts"),
    (r"revs?\b|turns?\b", "rev"),
    (r"mnm\b|mn_?m\b", "mN.m"),
    (r"ncm\b", "N.cm"),
    (r"nm\b|n_?m\b", "N.m"),
    (r"ma\b|milliamps?\b", "mA"),
    (r"a\b|amps?\b|amperes?\b|currents?\b", "A"),
    (r"mv\b|millivolts?\b", "mV"),
    (r"v\b|volts?\b|voltages?\b|vm\b", "V"),
)
_ANGLES, _ELECTRICAL = ("rad", "mrad", "deg", "rev", "counts"), ("A", "mA", "V", "mV")
_CLOCKS = (
    ("ns", r"ns\b|nsecs?\b|nanos?\b|nanosec(?:ond)?s?\b"),
    ("us", r"us\b|usecs?\b|micros?\b|microsec(?:ond)?s?\b"),
    ("ms", r"ms\b|msecs?\b|millis?\b|millisec(?:ond)?s?\b"),
    ("s", r"s\b|secs?\b|seconds?\b"),
)
"""Units of stamps as words of a column's name."""
_PLAUSIBLE_STEPS = (1e-5, 2.0)
"""Median steps of a joint's log [s]; a unit that a name seems to say and that makes another is none."""
_DAYS = ((20_000.0, 80_000.0), (690_000.0, 780_000.0))
"""Days since 1900, as spreadsheets count them, and since the year 0, as MATLAB does."""
_SIDES = r"motor|rotor|hub|link|load|output|spring|deflect|set_?point|theta|sensor"
"""Words that say which part of a joint an element of a message is of."""
_LOOKED_AT = 20_000
_MOST_RUNS = 10_000


def _end_of_word(pattern: str) -> str:
    """Return a pattern in which a word ends at a digit or an underscore too, unlike Python's."""
    return pattern.replace(r"\b", r"(?![a-z])")


@dataclass(frozen=True)
class Guess:
    """One signal's place.

    Args:
        name: of the signal.
        column: of the file.
        unit: there.
        reasons: for all of it.
        sign: 1 or −1.
        gear_ratio: 1 where there is none.
        wraps_at: `None` where it does not wrap.
        clock: the column of its stamps, where they are not the clock's.
    """

    name: str
    column: str
    unit: str
    reasons: tuple[str, ...]
    sign: int = 1
    gear_ratio: float = 1.0
    wraps_at: float | None = None
    clock: str | None = None


@dataclass(frozen=True)
class Proposal:
    """A whole map.

    Args:
        kind: of the joint.
        clock: column, unit (`None` where its type is one) and reason.
        guesses: of the signals.
        select: column and value of one run, and why; `None` where the log is one.
        lacking: what the kind needs and no column fits.
        others: columns that nothing fits.
        notes: what was found in the file and not told.
        file: the same, as the `[file]` table.
        nanoseconds: the column of what is to be added to whole seconds, if there is one.
    """

    kind: Kind
    clock: tuple[str, str | None, str]
    guesses: tuple[Guess, ...]
    select: tuple[str, str | float, str] | None
    lacking: tuple[str, ...]
    others: tuple[str, ...]
    notes: tuple[str, ...] = ()
    file: Mapping[str, Any] = field(default_factory=dict)
    nanoseconds: str | None = None


def propose(path: Path) -> Proposal:
    """Return a proposal for a log.

    Raises:
        InputError: the log cannot be read, or no column can be a clock.
    """
    log = open_log(path)
    notes = log.notes
    numbers = {name: values for stream in log.streams for name, values in _numbers(stream, notes).items()}
    stream, clock = _guess_clock(log, numbers)
    nanoseconds = _nanoseconds_beside(clock[0], stream, numbers)
    if nanoseconds is not None:
        clock = clock[0], None, f"whole seconds, beside the nanoseconds of {nanoseconds}"
    taken = {clock[0], nanoseconds, *_stamps(log, numbers)}
    matched: list[tuple[str, str, str]] = []
    for name, patterns in _NAMES:
        matches = ((_first_match(numbers, pattern, taken), pattern) for pattern in patterns)
        column, pattern = next((match for match in matches if match[0]), (None, ""))
        if column is not None:
            taken.add(column)
            matched.append((name, column, pattern))
    stream = log.main(clock[0], (column for _, column, _ in matched)) if stream.shared else stream
    guesses = [_guess(name, column, numbers[column], log, stream, pattern) for name, column, pattern in matched]
    guesses = _relate(guesses, numbers)
    present = {guess.name for guess in guesses}
    kind: Kind = "antagonistic" if "motor1_position" in present else "sea"
    if "setpoint_position" in present:
        kind = "serial"
    guesses = [guess for guess in guesses if guess.name in signals_of(kind)]
    lacking = tuple(name_need(need) for need in unmet_needs(kind, {guess.name for guess in guesses}))
    mapped = {clock[0], nanoseconds, *(guess.column for guess in guesses)}
    select = _guess_selection(stream, clock[0])
    others = tuple(n for n in log.names if n and n not in mapped)
    notes += _unsaid_of_bag(log)
    keys = {key: value for one in log.streams for key, value in one.keys.items()}
    return Proposal(kind, clock, tuple(guesses), select, lacking, others, tuple(notes), keys, nanoseconds)


def _numbers(stream: LogFile, notes: list[str]) -> dict[str, np.ndarray]:
    """Return the columns of numbers, and most of those that a few cells keep from being one, with a note."""
    found = {}
    everything = np.arange(stream.table.num_rows)
    for name in stream.names:
        try:
            found[name] = stream.numbers(name, stream.filled([name], everything)[:_LOOKED_AT])
        except InputError as error:
            good = stream.numeric_rows(name)
            if good.size:
                found[name] = stream.numbers(name, good[:_LOOKED_AT])
                notes += [f"to be mended first: {m.place}: {m.problem}; {m.fix}" for m in error.mistakes]
    return found


def _plain(name: str) -> str:
    """Return a name with its units and indices apart, for patterns."""
    return re.sub(r"[^a-z0-9°]+", "_", name.lower()).strip("_")


def _unsaid_of_bag(log: Log) -> list[str]:
    """Return notes on topics that could not be read, and on those of several publishers."""
    notes = [
        f"topic {topic} is not read: neither the bag nor this program has the definition of {kind}"
        for topic, kind in log.unread.items()
    ]
    for stream in log.streams:
        if stream.publisher is not None:
            writers = sorted(set(stream.column(stream.publisher).to_pylist()))
            told = " or ".join(f'"{stream.publisher}" = {_quoted(writer)}' for writer in writers)
            notes.append(f"several publishers on one topic, told apart in [select] where it matters: {told}")
    return notes


def _spoken(name: str) -> str:
    """Return what a column is called, for patterns: an element of a message by its own name before its topic's."""
    element = re.fullmatch(r"(/.+)/([^/\[\]]+)\[([^\]]*[A-Za-z][^\]]*)\](.*)", name)
    if element and re.search(_SIDES, element[3].lower()):
        return _plain(f"{element[3]}_{element[2]}{element[4]}")
    # Every joint of a robot is in a topic of this name.
    return _plain(re.sub(r"(?i)joint_?states?", "", name) if name.startswith("/") else name)


def _first_match(numbers: dict[str, np.ndarray], pattern: str, taken: set[str | None]) -> str | None:
    for name, values in numbers.items():
        plain = _spoken(name)
        if name in taken or values.size < 2 or re.search(_NOT_MEASURED, plain) or not np.ptp(values.astype(float)):
            continue
        if re.search(_end_of_word(pattern), plain):
            return name
    return None


def _stamps(log: Log, numbers: dict[str, np.ndarray]) -> set[str]:
    return {name for name in numbers if re.search(_TIME, _plain(name)) and _rises(numbers[name])} | {
        stream.clock for stream in log.streams if stream.clock
    }


def _rises(values: np.ndarray) -> bool:
    return len(values) > 2 and bool(np.mean(np.diff(values) >= 0) > 0.99)


def _guess_clock(log: Log, numbers: dict[str, np.ndarray]) -> tuple[LogFile, tuple[str, str | None, str]]:
    # A timeout has the word in it too, but stands.
    named = [n for n in numbers if re.search(_TIME, _plain(n)) and _rises(numbers[n]) and np.ptp(numbers[n])]
    rising = [n for n in numbers if _rises(numbers[n]) and np.all(np.diff(numbers[n]) > 0)]
    own = [stream.clock for stream in log.streams if stream.clock]
    pairs = [n for n in numbers if _rises(numbers[n]) and _nanoseconds_beside(n, log.of(n), numbers)]
    candidates = own or named or pairs or rising
    if not candidates:
        standing = next((n for n in numbers if re.search(_TIME, _plain(n)) and not np.ptp(numbers[n])), None)
        if standing is not None and numbers[standing].size > 1:
            raise input_error(
                log.path,
                f"has no column that rises as a clock: {standing!r} is {numbers[standing][0]} in every sample",
                "if its stamps have lost their digits, write a signal map by hand, with clock.nominal_step",
            )
        raise input_error(
            log.path,
            f"has no column that rises as a clock does; its columns: {', '.join(map(printable, log.names))}",
            "say by hand what is what, in a signal map (an example: vsajax init logs/hebi map.toml); "
            "is the header another line? then header = N in [file]",
        )
    column = candidates[0]
    why = "its name, and it rises" if column in named or column in own else "it is the first column that rises"
    stream = log.of(column)
    unit, reason = _clock_unit(column, numbers[column], stream)
    equal = np.diff(numbers[column]) == 0
    if np.mean(equal) > 0.1:
        share = f"{np.count_nonzero(equal)} of {equal.size + 1}"
        reason += f"; {share} stamps are those of the sample before: see clock.nominal_step and drop_duplicates"
    return stream, (column, unit, f"{why}; {reason}")


def _nanoseconds_beside(clock: str, stream: LogFile, numbers: dict[str, np.ndarray]) -> str | None:
    """Return the column after that of whole seconds which holds what is to be added to them in ns."""
    place = stream.names.index(clock) + 1
    beside = stream.names[place] if place < len(stream.names) else None
    if beside not in numbers or stream.holds_dates(clock) or len(numbers[beside]) != len(numbers[clock]):
        return None
    seconds, rest = numbers[clock], numbers[beside]
    if not all(np.issubdtype(values.dtype, np.integer) for values in (seconds, rest)):
        return None
    if rest.min() < 0 or rest.max() >= 10**9 or rest.max() < 10**6 or not np.ptp(rest):
        return None
    joined = seconds * 10**9 + rest
    runs = np.diff(seconds) == 0
    # Within a second the nanoseconds rise; where a second ends they begin anew.
    return beside if runs.any() and (np.diff(rest)[runs] > 0).all() and (np.diff(joined) > 0).all() else None


def _clock_unit(column: str, stamps: np.ndarray, stream: LogFile) -> tuple[str | None, str]:
    """Return the unit of stamps, `None` where their type is one, and why."""
    if stream.holds_dates(column):
        return None, f"it holds {stream.type_of(column)}, which have a unit and a zero of their own"
    steps = np.diff(stamps.astype(float))
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    reason = ""
    low, high = _PLAUSIBLE_STEPS
    words = _plain(re.sub("(?<=[a-z])(?=[A-Z])", "_", column))
    said = unit_named(stream.units.get(column, ""))
    named = next((u for u, p in _CLOCKS if re.search(rf"(?<![a-z])(?:{_end_of_word(p)})", words)), None)
    for unit, source in ((said, "the line of units"), (named, "its name")):
        if unit not in PER_SECOND:
            continue
        if low <= step / PER_SECOND[unit] <= high:
            return unit, f"unit {unit} by {source}"
        reason = f"{source} says {unit}, which steps of {step:.4g} contradict; "
    if "stamp" in column and np.issubdtype(stamps.dtype, np.integer) and stamps[0] > 10**17:
        return "ns", f"{reason}nanoseconds since 1970 by its size"
    first = float(stamps[0])
    if step < low and low <= step / PER_SECOND["d"] <= high and any(a < first < b for a, b in _DAYS):
        return "d", f"{reason}unit d, as days of a spreadsheet or of MATLAB that step by {step:.4g}"
    unit = next((u for u, scale in PER_SECOND.items() if step < 0.2 * scale), "ns")
    doubt = "" if low <= step / PER_SECOND[unit] <= high else ", which is NOT PLAUSIBLE: look it up"
    return unit, f"{reason}unit {unit}, as it steps by {step:.4g}{doubt}"


def _guess(name: str, column: str, values: np.ndarray, log: Log, main: LogFile, pattern: str) -> Guess:
    plain, span = _spoken(column), float(np.ptp(values.astype(float)))
    is_angle = name.endswith("position") or name == "deflection"
    word = re.search(_end_of_word(pattern), plain)
    reasons = [f"its name says {word[0] if word else plain}"]
    allowed = _ANGLES if is_angle else ("N.m", "mN.m", "N.cm", *_ELECTRICAL)
    if name == "true_stiffness":
        allowed = ("N.m/rad",)
    # torqueNm is torque_Nm, but torque_mNm is not torque_m_Nm.
    spellings = (plain, _spoken(re.sub("(?<=[a-z])(?=[A-Z])", "_", column)))
    named = (
        unit
        for words in spellings
        for pattern, unit in _UNITS
        if unit in allowed and re.search(rf"(?<![a-z])(?:{_end_of_word(pattern)})", words)
    )
    # A count is a whole number, whatever the name says.
    is_whole = bool(np.all(values == np.round(values)))
    unit = next((u for u in named if u != "counts" or is_whole), None)
    said = log.of(column).units.get(column, "")
    if unit_named(said) in allowed:
        unit = unit_named(said) or ""
        reasons.append(f"unit {unit} by the line of units")
    elif unit is not None:
        reasons.append(f"unit {unit} by its name")
    elif is_angle and np.issubdtype(values.dtype, np.integer) and span > 50:
        unit = "counts"
        reasons.append("whole numbers: counts")
    elif is_angle:
        limit = 1.5 if name == "deflection" else 16.0 * math.pi
        unit = "deg" if span > limit else "rad"
        reasons.append(f"it spans {span:.4g}: {unit}")
    else:
        unit = allowed[0]
        reasons.append(f"no unit in its name: {unit} supposed")
    stream = log.of(column)
    clock = stream.clock if stream is not main else None
    if stream is not main and clock is None:
        clock = next((n for n in stream.names if re.search(_TIME, _plain(n))), stream.names[0])
    wraps_at = None
    if is_angle and unit != "counts":
        probe = Angle(column=column, unit=unit)  # pyright: ignore[reportArgumentType]
        for fault in find_wraps(name, probe, values.astype(float), stream, np.arange(len(values))):
            found = re.search(r"wraps_at = ([0-9.]+)", fault.fix)
            wraps_at = float(found[1]) if found else None
            reasons.append(fault.problem)
    return Guess(name, column, unit, tuple(reasons), wraps_at=wraps_at, clock=clock)


def _relate(guesses: Sequence[Guess], numbers: dict[str, np.ndarray]) -> list[Guess]:
    """Refine guesses by what columns say of one another: signs, and a gear."""
    found = {guess.name: guess for guess in guesses}

    def values(name: str) -> np.ndarray:
        return numbers[found[name].column].astype(float)

    def share_rows(a: str, b: str) -> bool:
        pair = [found[name] for name in (a, b) if name in found]
        return len(pair) == 2 and not any(g.clock for g in pair) and len(values(a)) == len(values(b))

    if share_rows("deflection", "elastic_torque"):
        correlation = float(np.corrcoef(values("deflection"), values("elastic_torque"))[0, 1])
        if correlation < -0.5:
            torque = found["elastic_torque"]
            reason = f"sign -1, as it falls when the deflection rises (correlation {correlation:.2f})"
            found["elastic_torque"] = replace(torque, sign=-1, reasons=(*torque.reasons, reason))
    if share_rows("motor_position", "link_position"):
        found["motor_position"] = _behind_gear(
            found["motor_position"], found["link_position"], values("motor_position"), values("link_position")
        )
    return list(found.values())


def _behind_gear(motor: Guess, link: Guess, turned: np.ndarray, moved: np.ndarray) -> Guess:
    """Return the guess of a motor's position with the sign and the gear that its link's tells."""
    correlation = float(np.corrcoef(moved, turned)[0, 1])
    if not abs(correlation) > 0.95:
        return motor
    reasons = [reason for reason in motor.reasons if not reason.startswith("it spans")]
    unit = motor.unit
    if len(reasons) < len(motor.reasons):
        unit = link.unit
        reasons.append(f"unit {unit}, as the link's")
    if correlation < 0:
        reasons.append("sign -1, as it falls when the link rises")
    # The finer encoder is the motor's.
    factor = abs(correlation) * float(np.std(turned) / np.std(moved)) / correlation**2
    if unit != link.unit or not 1.5 < factor < 2000.0:
        return replace(motor, unit=unit, sign=int(np.sign(correlation)), reasons=tuple(reasons))
    reasons.append(f"gear_ratio {factor:.5g}, as it moves so many times as far as the link")
    return replace(motor, unit=unit, sign=int(np.sign(correlation)), gear_ratio=factor, reasons=tuple(reasons))


def _guess_selection(stream: LogFile, clock: str) -> tuple[str, str | float, str] | None:
    """Return column, value and reason of a selection, where time runs back and a column tells the runs apart."""
    try:
        back = np.flatnonzero(np.diff(stream.numbers(clock, np.arange(stream.table.num_rows)).astype(float)) < 0)
    except InputError:
        return None
    if not 0 < back.size < _MOST_RUNS:
        return None
    for name in stream.names:
        cells = stream.column(name).to_pylist()
        if isinstance(cells[0], str | int) and all(cells[i] != cells[i + 1] for i in back.tolist()):
            runs = len(set(cells))
            if runs <= 2 * (back.size + 1):
                return (
                    name,
                    cells[0],
                    f"time runs back {back.size} times: one of {runs} runs, told apart by {name}",
                )
    return None


def to_map(proposal: Proposal, path: Path) -> str:
    """Return a proposal as the commented text of a signal map."""
    column, unit, reason = proposal.clock
    lines = [
        f"# Signal map proposed for {printable(path.name)} from names and numbers: check every line.",
        "# `vsajax init logs/hebi` explains every key. Then:",
        "# vsajax estimate LOG --map THIS -c CONFIG --report log.html",
        "",
        "schema_version = 1",
        f'kind = "{proposal.kind}"',
    ]
    if proposal.file:
        lines += ["", "[file]", *(f"# {printable(note)}" for note in proposal.notes)]
        lines += [f"{key} = {_toml(value)}" for key, value in proposal.file.items()]
    lines += ["", "[clock]", f"# {printable(reason)}", f"column = {_quoted(column)}"]
    if unit is not None:
        lines.append(f'unit = "{unit}"')
    if proposal.nanoseconds is not None:
        lines.append(f"nanoseconds = {_quoted(proposal.nanoseconds)}")
    if any(guess.clock for guess in proposal.guesses):
        lines.append('resample = "linear" # signals have stamps of their own')
    if proposal.select is not None:
        name, value, why = proposal.select
        lines += [
            "",
            "[select]",
            f"# {printable(why)}",
            f"{_quoted(name)} = {_quoted(value) if isinstance(value, str) else value}",
        ]
    for guess in proposal.guesses:
        lines += ["", f"[signals.{guess.name}]", *(f"# {printable(reason)}" for reason in guess.reasons)]
        lines += [f"column = {_quoted(guess.column)}", f'unit = "{guess.unit}"']
        if guess.clock:
            lines.append(f"clock = {_quoted(guess.clock)}")
        if guess.sign != 1:
            lines.append("sign = -1")
        if guess.gear_ratio != 1.0:
            lines.append(f"gear_ratio = {guess.gear_ratio:.6g}")
        if guess.wraps_at is not None:
            lines.append(f"wraps_at = {guess.wraps_at:.10g}")
        if guess.unit == "counts":
            lines.append("counts_per_revolution = 4096.0 # SUPPOSED: look it up")
        if guess.unit in _ELECTRICAL:
            lines.append(
                f"scale = 1.0 # SUPPOSED: {'N.m' if 'torque' in guess.name else 'rad'} per {guess.unit[-1]}"
            )
    if not proposal.guesses:
        lines += ["", "[signals]"]
    for need in proposal.lacking:
        lines += ["", f"# MISSING: no column looks like {need}, which kind {proposal.kind!r} needs."]
    if proposal.others:
        lines += ["", "# Columns left over:", *(f"#   {printable(name)}" for name in proposal.others[:40])]
    return "\n".join(lines) + "\n"


def _toml(value: Any) -> str:
    if isinstance(value, str):
        return _quoted(value)
    if isinstance(value, bool):
        return "true" if value else "false"
    return f"[{', '.join(map(_toml, value))}]" if isinstance(value, list | tuple) else str(value)


def _quoted(text: str) -> str:
    """Return text as a basic string of TOML, on one line."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    # TOML knows \u and \U, not Python's \x.
    shown = (
        c if printable(c) == c else f"\\u{ord(c):04X}" if ord(c) < 0x10000 else f"\\U{ord(c):08X}" for c in escaped
    )
    return f'"{"".join(shown)}"'
