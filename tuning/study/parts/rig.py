"""What drives a joint, what measures it, and how an estimate is scored."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from tuning.files.toml import Seed
from tuning.study.parts.base import AtLeastOne, NonNegative, Part, Positive
from tuning.study.refs import Ref
from tuning.study.slots import Slot


class Sine(Part):
    """offset + amplitude · sin(2π frequency t + phase)."""

    target = Ref("vsajax.sensing:Sine")
    type: Literal["sine"]
    amplitude: float
    frequency: NonNegative
    phase: float = 0.0
    offset: float = 0.0


class Multisine(Part):
    """A sum of sines."""

    target = Ref("vsajax.sensing:Multisine")
    type: Literal["multisine"]
    amplitudes: Annotated[list[float], Field(min_length=1)]
    frequencies: list[NonNegative]
    phases: list[float]
    offset: float = 0.0

    @model_validator(mode="after")
    def _same_length(self) -> Multisine:
        if not len(self.amplitudes) == len(self.frequencies) == len(self.phases):
            raise ValueError(
                f"amplitudes, frequencies and phases need one length; got {len(self.amplitudes)}, "
                f"{len(self.frequencies)} and {len(self.phases)}"
            )
        return self


class Chirp(Part):
    """A sine of rising frequency."""

    target = Ref("vsajax.sensing:Chirp")
    type: Literal["chirp"]
    amplitude: float
    start: NonNegative
    stop: NonNegative
    duration: Positive
    offset: float = 0.0


class BandLimitedNoise(Part):
    """Gaussian noise between two frequencies."""

    target = Ref("vsajax.sensing:BandLimitedNoise")
    ordered = ("low", "high", "Hz")
    type: Literal["noise"]
    std: NonNegative
    low: NonNegative
    high: Positive
    offset: float = 0.0
    seed: Seed = 0
    tones: AtLeastOne = 32


class RecordedTorque(Part):
    """A torque column of a recording, CSV or Parquet, with its time column."""

    target = Ref("vsajax.sensing:Recorded")
    files = ("path",)
    type: Literal["file"]
    path: str
    column: str = "motor_torque"

    def arguments(self) -> dict[str, Any]:
        """Read the file."""
        from tuning.logs.reading import read_series

        time, torque = read_series(Path(self.path), self.column)
        return {"time": time, "torque": torque}


EXCITATIONS = Slot("excitations", Part, Sine, Multisine, Chirp, BandLimitedNoise, RecordedTorque)
TorqueProfile = Annotated[Part, EXCITATIONS]


class Excitation(Part):
    """What drives each input of the joint; an absent one is no torque."""

    target = Ref("vsajax.sensing:Excitation")
    motor: TorqueProfile | None = None
    setpoint_motor: TorqueProfile | None = None
    external: TorqueProfile | None = None
    motor1: TorqueProfile | None = None
    motor2: TorqueProfile | None = None


class Encoder(Part):
    """Quantisation of an angle."""

    target = Ref("vsajax.sensing:Encoder")
    counts_per_revolution: Positive
    offset: float | None = None
    rounding: Literal["nearest", "floor"] = "nearest"


class Sensor(Part):
    """One measured signal; an absent effect costs nothing."""

    target = Ref("vsajax.sensing:Sensor")
    delay: NonNegative | None = None
    gain: Positive | None = None
    bias: float | None = None
    noise_std: NonNegative | None = None
    encoder: Encoder | None = None


SENSORS = Slot("sensors", Part, untagged={"plain": Sensor}, otherwise="plain")
AnySensor = Annotated[Part, SENSORS]


class Sensing(Part):
    """One sensor a signal; an absent one is not measured."""

    target = Ref("vsajax.sensing:SensorSuite")
    link_position: AnySensor | None = None
    motor_position: AnySensor | None = None
    setpoint_position: AnySensor | None = None
    motor_torque: AnySensor | None = None
    elastic_torque: AnySensor | None = None
    deflection: AnySensor | None = None
    motor1_position: AnySensor | None = None
    motor2_position: AnySensor | None = None
    motor1_torque: AnySensor | None = None
    motor2_torque: AnySensor | None = None


class Clock(Part):
    """When samples are taken."""

    target = Ref("vsajax.sensing:Clock")
    static = frozenset({"sample_time", "duration"})
    sample_time: Positive
    duration: Positive
    jitter_std: Positive | None = None

    @model_validator(mode="after")
    def _enough_samples(self) -> Clock:
        if self.duration < 2 * self.sample_time:
            raise ValueError(f"duration must hold at least two sample times; got {self.duration} s")
        return self


class Scorer(Part):
    """How estimates are compared with the truth."""

    target = Ref("vsajax.scores:Scorer")
    warm_up: NonNegative = 2.0
    tolerance: Positive = 0.05
    sigmas: Positive = 1.959963984540054
    stiffness_floor: NonNegative = 0.0
