"""Signal maps: which column of a foreign log is which signal, and in what unit.

A map is a TOML file; `vsajax init logs/hebi` writes a commented example to copy.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self, get_args

import numpy as np
import pydantic

from tuning.files.kinds import SIGNAL_MAP, require_kind
from tuning.files.tables import with_settings
from tuning.files.toml import NO_SWITCH, SchemaVersion, Table, read_toml, validate
from tuning.logs.layout import AS_FOUND, FileFormat

Kind = Literal["serial", "antagonistic", "sea"]
KINDS: tuple[Kind, ...] = get_args(Kind)

Need = tuple[tuple[str, ...], ...]
"""Alternatives, any of which will do; an alternative is the signals it takes."""


def _each(*names: str) -> tuple[Need, ...]:
    return tuple(((name,),) for name in names)


_NEEDS: dict[Kind, tuple[Need, ...]] = {
    "serial": (
        *_each("link_position", "motor_position", "setpoint_position"),
        (("motor_torque",), ("elastic_torque",)),
    ),
    "antagonistic": _each("link_position", "motor1_position", "motor2_position", "motor1_torque", "motor2_torque"),
    "sea": (
        (("deflection",), ("link_position", "motor_position")),
        (("elastic_torque",), ("motor_torque",)),
    ),
}
_EXTRAS: dict[Kind, tuple[str, ...]] = {
    "serial": ("deflection",),
    "antagonistic": (),
    "sea": (),
}
_ON_MOTOR_AXIS = ("motor_torque", "motor1_torque", "motor2_torque")
_TRUTH = ("true_stiffness", "true_elastic_torque")


def signals_of(kind: Kind) -> tuple[str, ...]:
    """Return the canonical signals a recording of this kind may hold, `time` apart."""
    needed = (name for need in _NEEDS[kind] for alternative in need for name in alternative)
    return (*needed, *_EXTRAS[kind], *_TRUTH)


def unmet_needs(kind: Kind, present: set[str]) -> list[Need]:
    """Return what a recording of this kind still lacks when it holds the signals `present`."""
    return [need for need in _NEEDS[kind] if not any(present.issuperset(names) for names in need)]


def name_need(need: Need) -> str:
    """Return a need in words, e.g. ``deflection (or link_position and motor_position)``."""
    first, *others = [" and ".join(names) for names in need]
    return f"{first} (or {' or '.join(others)})" if others else first


_Finite = Annotated[float, pydantic.Field(strict=True)]
_Positive = Annotated[float, pydantic.Field(strict=True, gt=0)]

_RADIANS = {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180.0, "rev": 2.0 * math.pi}
_NEWTON_METRES = {"N.m": 1.0, "mN.m": 1e-3, "N.cm": 1e-2}
_STIFFNESSES = {"N.m/rad": 1.0, "mN.m/rad": 1e-3, "N.m/deg": 180.0 / math.pi}
_ELECTRICAL = {"A": 1.0, "mA": 1e-3, "V": 1.0, "mV": 1e-3}


Interval = Annotated[list[_Finite], pydantic.Field(min_length=2, max_length=2)]


def _ordered(interval: list[float] | None) -> list[float] | None:
    if interval is not None and not interval[0] < interval[1]:
        raise ValueError(f"the first must be below the second; got {interval}")
    return interval


def _scale_missing(unit: str, scale: float | None, target: str) -> str | None:
    if unit in _ELECTRICAL and scale is None:
        return f"unit {unit!r} needs scale, in {target} per {unit.removeprefix('m')}"
    return None


class _Signal(Table):
    column: str
    sign: Annotated[Literal[1, -1], NO_SWITCH] = 1
    offset: _Finite = 0.0
    scale: _Finite | None = None
    clock: str | None = None
    range: Interval | None = None

    _order = pydantic.field_validator("range")(_ordered)

    @pydantic.field_validator("scale")
    @classmethod
    def _not_zero(cls, scale: float | None) -> float | None:
        if scale == 0.0:
            raise ValueError("got 0; a scale of zero erases the signal")
        return scale

    def _in_si(self, values: np.ndarray, unit_in_si: float) -> np.ndarray:
        scale = 1.0 if self.scale is None else self.scale
        return (values - self.offset) * (self.sign * scale * unit_in_si)


class Drive(Table):
    """A DC motor behind a voltage V: torque = efficiency · torque_constant · current, from its winding's equation.

    current = (V − back_emf_constant · ω) / resistance, the inductance neglected; ω is the speed of the motor's
    own shaft, gear_ratio times that of `motor_position`, by central differences.

    Args:
        torque_constant: [N.m/A].
        resistance: of the winding, with the amplifier's [Ohm].
        back_emf_constant: [V.s/rad], in numbers that of torque; 0 where the amplifier controls the current.
        gear_ratio: motor turns per joint turn.
        efficiency: of motor and gear.
    """

    torque_constant: _Positive
    resistance: _Positive
    back_emf_constant: Annotated[float, pydantic.Field(strict=True, ge=0)] = 0.0
    gear_ratio: _Positive = 1.0
    efficiency: Annotated[float, pydantic.Field(strict=True, gt=0, le=1)] = 1.0

    def torque(self, voltage: np.ndarray, time: np.ndarray, position: np.ndarray) -> np.ndarray:
        """Return the torque on the motor's shaft [N.m] from volts, seconds and radians at the joint."""
        speed = self.gear_ratio * np.gradient(position, time) if self.back_emf_constant else 0.0
        return (
            self.efficiency * self.torque_constant * (voltage - self.back_emf_constant * speed) / self.resistance
        )


class Angle(_Signal):
    """A position or deflection: ``sign * scale * (unwrapped - offset) * unit / gear_ratio`` [rad].

    Args:
        column: its name in the file.
        unit: of the file; "V" is a potentiometer and needs `scale` in rad/V.
        sign: -1 where the file counts the other way.
        offset: reading at zero, in the file's unit; subtracted after unwrapping, before anything else.
        scale: free factor.
        gear_ratio: motor turns per joint turn, for an angle measured on the motor shaft; divides.
        counts_per_revolution: of the encoder, after quadrature; required for unit "counts" only.
        wraps_at: the reading at which the counter starts again, in the file's unit; undoes the wraps.
        clock: the column of its own time stamps, where they are not those of `[clock]`.
        range: what it may be, in SI; anything else is a fault.
    """

    unit: Literal["rad", "mrad", "deg", "rev", "counts", "V", "mV"]
    gear_ratio: _Positive = 1.0
    counts_per_revolution: _Positive | None = None
    wraps_at: _Positive | None = None

    @pydantic.model_validator(mode="after")
    def _consistent(self) -> Self:
        if problem := _scale_missing(self.unit, self.scale, "rad"):
            raise ValueError(problem)
        if self.unit == "counts" and self.counts_per_revolution is None:
            raise ValueError("unit 'counts' needs counts_per_revolution")
        if self.unit != "counts" and self.counts_per_revolution is not None:
            raise ValueError(f"counts_per_revolution goes with unit 'counts', not with {self.unit!r}")
        return self

    def wrap_problem(self, values: np.ndarray) -> str | None:
        """Return why `values` cannot have come from a counter that wraps at `wraps_at`, or None."""
        span = float(np.ptp(values))
        # One percent lets analogue readings overshoot, and a period be written with few digits.
        if self.wraps_at is None or span <= 1.01 * self.wraps_at:
            return None
        return f"spans {span:.6g} {self.unit}, more than wraps_at = {self.wraps_at:g}"

    def count_wraps(self, values: np.ndarray) -> int:
        """Return at how many samples the raw reading wrapped."""
        if self.wraps_at is None:
            return 0
        return int(np.count_nonzero(np.abs(np.diff(values)) > self.wraps_at / 2.0))

    def to_si(self, values: np.ndarray) -> np.ndarray:
        """Return a file's readings in radians at the joint."""
        if self.wraps_at is not None:
            values = np.unwrap(values, period=self.wraps_at)
        if self.counts_per_revolution is not None:
            unit_in_si = 2.0 * math.pi / self.counts_per_revolution
        else:
            unit_in_si = (_RADIANS | _ELECTRICAL)[self.unit]
        return self._in_si(values, unit_in_si) / self.gear_ratio


class Torque(_Signal):
    """A torque: ``sign * scale * (reading - offset) * unit * gear_ratio`` [N.m].

    Args:
        column: its name in the file.
        unit: of the file; an electrical one needs `scale`, e.g. a torque constant in N.m/A.
        sign: -1 where the file counts the other way.
        offset: reading at zero torque, in the file's unit; subtracted before anything else.
        scale: free factor.
        gear_ratio: motor turns per joint turn, for an elastic torque measured on the motor shaft; multiplies.
            The motor torques themselves stay on the motor axis and take none.
        drive: the motor, where the file has its voltage; in the place of `scale`.
        clock: as for an angle.
        range: as for an angle.
    """

    unit: Literal["N.m", "mN.m", "N.cm", "A", "mA", "V", "mV"]
    gear_ratio: _Positive = 1.0
    drive: Drive | None = None

    @pydantic.model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.drive is not None:
            if self.unit not in ("V", "mV"):
                raise ValueError(f"drive makes a torque of a voltage, unit 'V' or 'mV'; got {self.unit!r}")
            if self.scale is not None:
                raise ValueError("scale and drive both make a torque of a voltage: remove one")
        elif problem := _scale_missing(self.unit, self.scale, "N.m"):
            raise ValueError(problem)
        return self

    def to_si(self, values: np.ndarray) -> np.ndarray:
        """Return a file's readings in newton metres; in volts, where a `drive` makes torques of them later."""
        return self._in_si(values, (_NEWTON_METRES | _ELECTRICAL)[self.unit]) * self.gear_ratio


class Stiffness(_Signal):
    """A stiffness that a simulation knows: ``sign * scale * (reading - offset) * unit`` [N.m/rad]."""

    unit: Literal["N.m/rad", "mN.m/rad", "N.m/deg"]

    def to_si(self, values: np.ndarray) -> np.ndarray:
        """Return a file's readings in newton metres per radian."""
        return self._in_si(values, _STIFFNESSES[self.unit])


class Signals(Table):
    """The canonical signals and where each is found."""

    link_position: Angle | None = None
    motor_position: Angle | None = None
    setpoint_position: Angle | None = None
    motor1_position: Angle | None = None
    motor2_position: Angle | None = None
    deflection: Angle | None = None
    motor_torque: Torque | None = None
    motor1_torque: Torque | None = None
    motor2_torque: Torque | None = None
    elastic_torque: Torque | None = None
    true_elastic_torque: Torque | None = None
    true_stiffness: Stiffness | None = None

    def given(self) -> dict[str, Angle | Torque | Stiffness]:
        """Return the signals that are mapped, by canonical name."""
        return {name: signal for name, signal in self if signal is not None}


PER_SECOND = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9, "d": 1.0 / 86400.0}
"""Units of time stamps; spreadsheets and MATLAB count days."""


class Clock(Table):
    """The time stamps.

    Args:
        column: its name in the file.
        unit: of the file; not needed where the column holds dates or durations, which have one of their own.
        nanoseconds: the column of what is to be added to `column`, which then holds whole seconds.
        not_before: samples with earlier stamps are left out, in the file's unit: the clock was not set yet. Dates
            as text, in ISO 8601.
        nominal_step: where the stamps have lost their digits: samples are this far apart instead [s].
        drop_duplicates: keep the first of the samples that share a stamp, rather than refuse them.
        start_at_zero: subtract the first stamp (exactly, where stamps are integers).
        resample: how signals with other stamps are brought to these, "linear" or "previous"; by default they are
            refused.
        sample_time: bring everything to a regular clock [s]; needs `resample`.
    """

    column: str
    unit: Literal["s", "ms", "us", "ns", "d"] | None = None
    nanoseconds: str | None = None
    not_before: Annotated[int | float | str, pydantic.Field(union_mode="left_to_right")] | None = None
    nominal_step: _Positive | None = None
    drop_duplicates: bool = False
    start_at_zero: bool = True
    resample: Literal["linear", "previous"] | None = None
    sample_time: _Positive | None = None

    @pydantic.model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.sample_time is not None and self.resample is None:
            raise ValueError("sample_time needs resample, 'linear' or 'previous'")
        if self.nanoseconds is not None and self.unit not in (None, "s"):
            raise ValueError(f"nanoseconds are added to whole seconds, unit 's'; got {self.unit!r}")
        if self.nominal_step is not None and self.drop_duplicates:
            raise ValueError("nominal_step gives every sample a time of its own: leave drop_duplicates out")
        return self

    def to_seconds(self, stamps: np.ndarray, start: Any = None) -> np.ndarray:
        """Return stamps, integer or float, in seconds; from `start`, by default the first of them."""
        # Nanoseconds since 1970 do not fit a float64: subtract while they are still integers.
        elapsed = stamps - (stamps[0] if start is None else start) if self.start_at_zero else stamps
        return elapsed.astype(np.float64) / PER_SECOND[self.unit or "s"]


class Expect(Table):
    """What is known of the joint before the log is read; what contradicts it is a fault.

    Args:
        stiffness: between which it must lie [N.m/rad].
        no_load: from when to when nothing loads the joint, so that the torque signal shows its noise floor [s].
    """

    stiffness: Interval | None = None
    no_load: Interval | None = None

    _order = pydantic.field_validator("stiffness", "no_load")(_ordered)


class SignalMap(Table):
    """A whole signal map.

    Args:
        schema_version: 1.
        kind: of the joint.
        clock: the time stamps.
        join: further files of the same recording, in its folder.
        select: keep only the rows whose column equals the value, for files that hold many runs.
        file: how a text file is laid out, as far as the file itself does not tell.
        expect: what is known of the joint.
        signals: the rest.
    """

    schema_version: SchemaVersion
    kind: Kind
    clock: Clock
    join: list[str] = pydantic.Field(default_factory=list)
    file: FileFormat = AS_FOUND
    expect: Expect = Expect()
    select: dict[str, Any] = pydantic.Field(default_factory=dict)
    signals: Signals

    @pydantic.field_validator("select")
    @classmethod
    def _plain_values(cls, select: dict[str, Any]) -> dict[str, Any]:
        for column, value in select.items():
            if not isinstance(value, str | int | float):
                raise ValueError(f"{column} = {value!r} is neither a string, a number nor a boolean")
        return select

    @pydantic.model_validator(mode="after")
    def _fits_kind(self) -> Self:
        given = set(self.signals.given())
        foreign = sorted(given.difference(signals_of(self.kind)))
        problems = [f"signals.{name} does not belong to kind {self.kind!r}" for name in foreign]
        problems += [f"kind {self.kind!r} needs {name_need(n)}" for n in unmet_needs(self.kind, given)]
        problems += [
            f"signals.{name}.gear_ratio must stay out: the motor torque is kept on the motor axis, and the "
            "estimator's own torque.gear_ratio brings it to the joint"
            for name, signal in self.signals.given().items()
            if name in _ON_MOTOR_AXIS and isinstance(signal, Torque) and signal.gear_ratio != 1.0
        ]
        problems += [
            f"signals.{name}.drive belongs to a motor torque"
            for name, signal in self.signals.given().items()
            if isinstance(signal, Torque) and signal.drive is not None and name not in _ON_MOTOR_AXIS
        ]
        problems += [
            f"signals.{name}.drive needs signals.{position_of(name)}, for the back EMF"
            for name, signal in self.signals.given().items()
            if isinstance(signal, Torque)
            and signal.drive is not None
            and signal.drive.back_emf_constant
            and position_of(name) not in given
        ]
        if problems:
            raise ValueError("; ".join(problems))
        return self


def position_of(motor_torque: str) -> str:
    """Return the position signal of the motor whose torque signal this is."""
    return motor_torque.replace("torque", "position")


def read_signal_map(path: Path, settings: Sequence[str] = ()) -> SignalMap:
    """Return the signal map in a TOML file, with `a.b=value` settings applied before it is validated.

    Raises:
        InputError: listing every mistake with its key.
    """
    tables = with_settings(read_toml(path), settings)
    require_kind(tables, str(path), SIGNAL_MAP)
    return validate(SignalMap, tables, str(path))


def canonical_map(kind: Kind, present: set[str]) -> SignalMap:
    """Return the map of a file whose columns, `present`, are canonical and in SI units already."""
    si = {Angle: "rad", Torque: "N.m", Stiffness: "N.m/rad"}
    types = {name: get_args(Signals.model_fields[name].annotation)[0] for name in signals_of(kind)}
    return SignalMap(
        schema_version=1,
        kind=kind,
        clock=Clock(column="time", unit="s", start_at_zero=False),
        signals=Signals(**{n: t(column=n, unit=si[t]) for n, t in types.items() if n in present}),
    )
