"""What drives a joint and what is measured of it."""

from vsajax.sensing.excitations import (
    AbstractExcitation,
    BandLimitedNoise,
    Chirp,
    Excitation,
    Multisine,
    Recorded,
    Sine,
)
from vsajax.sensing.feedback import FeedbackSensor, FeedbackState
from vsajax.sensing.impacts import Impact, Pulse
from vsajax.sensing.sensors import Clock, Encoder, Sensor
from vsajax.sensing.suite import SensorSuite

__all__ = [
    "AbstractExcitation",
    "BandLimitedNoise",
    "Chirp",
    "Clock",
    "Encoder",
    "Excitation",
    "FeedbackSensor",
    "FeedbackState",
    "Impact",
    "Multisine",
    "Pulse",
    "Recorded",
    "Sensor",
    "SensorSuite",
    "Sine",
]
