"""Plants with controlled stiffness, what hits them, and controllers that bring them to rest."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from tuning.study.parts.base import AtLeastOne, NonNegative, Part, Positive
from tuning.study.parts.joints import Link
from tuning.study.parts.rig import Encoder
from tuning.study.refs import Ref
from tuning.study.slots import Slot


class SingleLink(Part):
    """One link on one joint."""

    target = Ref("vsajax.plants:SingleLink")
    link: Link


class StiffnessActuator(Part):
    """What sets the stiffness: its range, and the time from end to end of it."""

    target = Ref("vsajax.plants:StiffnessActuator")
    ordered = ("soft", "stiff", "N·m/rad")
    soft: Positive
    stiff: Positive
    travel_time: Positive | None = None


class PositionMotor(Part):
    """A position-controlled motor with a lag and a top speed."""

    target = Ref("vsajax.plants:PositionMotor")
    time_constant: Positive
    top_speed: Positive


class SwitchedPlant(Part):
    """A link on a spring whose stiffness is an input."""

    target = Ref("vsajax.plants:SwitchedPlant")
    mechanism: SingleLink
    actuator: StiffnessActuator
    motor: PositionMotor | None = None


PLANTS = Slot("plants", Part, untagged={"switched": SwitchedPlant}, otherwise="switched")
Plant = Annotated[Part, PLANTS]


class Pulse(Part):
    """A constant torque from the start on."""

    target = Ref("vsajax.sensing:Pulse")
    torque: float
    duration: Positive


class Impact(Part):
    """What sets the link swinging: an impulse, a pulse, or both."""

    target = Ref("vsajax.sensing:Impact")
    impulse: float = 0.0
    pulse: Pulse | None = None
    shares: Annotated[list[float], Field(min_length=1, max_length=1)] | None = None

    @model_validator(mode="after")
    def _hits(self) -> Self:
        if self.impulse == 0.0 and self.pulse is None:
            raise ValueError("impulse must not be 0 where there is no pulse: nothing would move")
        return self


class FeedbackSensor(Part):
    """The encoder of the link in the loop, and the delay of the whole loop; an absent effect costs nothing."""

    target = Ref("vsajax.sensing:FeedbackSensor")
    noise_std: NonNegative | None = None
    encoder: Encoder | None = None
    delay: NonNegative | None = None
    longest_delay: AtLeastOne = 20


class SwingObserver(Part):
    """How velocities are found from readings."""

    target = Ref("vsajax.control:SwingObserver")
    cutoff: Positive | None = None


class Conic(Part):
    """Law (23) with its two switching lines tilted; with zeros it is law (23)."""

    target = Ref("vsajax.control:Conic")
    type: Literal["conic"] = "conic"
    lead: float = 0.0
    slope: float = 0.0


class TimeLead(Part):
    """Law (23) on what deflection and velocity will be."""

    target = Ref("vsajax.control:TimeLead")
    type: Literal["lead"]
    position_lead: float
    velocity_lead: float


class FixedThresholds(Part):
    """The paper's anticipation."""

    target = Ref("vsajax.control:FixedThresholds")
    type: Literal["thresholds"]
    position: NonNegative
    velocity: NonNegative
    falls_back: bool = False


class RelativeThresholds(Part):
    """The same with thresholds that are shares of the last peaks."""

    target = Ref("vsajax.control:RelativeThresholds")
    type: Literal["relative"]
    position_share: NonNegative
    velocity_share: NonNegative


class DelayedRelease(Part):
    """Law (23), stiff for a share of the way out past the peak."""

    target = Ref("vsajax.control:DelayedRelease")
    type: Literal["release"]
    share: NonNegative


RULES = Slot("rules", Part, Conic, TimeLead, FixedThresholds, RelativeThresholds, DelayedRelease)
Rule = Annotated[Part, RULES]


class Hold(Part):
    """Keeps the last command where the drive's sign is not to be believed."""

    target = Ref("vsajax.control:Hold")
    product: NonNegative | None = None
    position: NonNegative | None = None
    velocity: NonNegative | None = None


class ConstantStiffness(Part):
    """One stiffness."""

    target = Ref("vsajax.control:ConstantStiffness")
    type: Literal["constant"]
    stiffness: Positive


class StiffnessSwitch(Part):
    """Switches between two stiffnesses by a rule."""

    target = Ref("vsajax.control:StiffnessSwitch")
    type: Literal["switch"]
    soft: Positive
    stiff: Positive
    rule: Rule = Conic()
    hold: Hold | None = None


class SmoothStiffness(Part):
    """Changes the stiffness smoothly by a conic."""

    target = Ref("vsajax.control:SmoothStiffness")
    type: Literal["smooth"]
    soft: Positive
    stiff: Positive
    sharpness: Positive
    rate: Positive
    floor: NonNegative = 0.05
    conic: Conic = Conic()


class PIDPosition(Part):
    """PID on the motor's position at a constant stiffness."""

    target = Ref("vsajax.control:PIDPosition")
    type: Literal["pid"]
    stiffness: Positive
    proportional: float
    integral: float
    derivative: float
    longest_integral: Positive = 0.2
    reach: Positive = 1.5


class MotorPID(Part):
    """PID on the motor's position."""

    target = Ref("vsajax.control:MotorPID")
    proportional: float
    integral: float
    derivative: float
    longest_integral: Positive = 0.2
    reach: Positive = 1.5


STIFFNESSES = Slot("controllers", Part, StiffnessSwitch, SmoothStiffness)
"""Controllers of the stiffness alone, beside which another moves the motor."""


class Combined(Part):
    """A controlled stiffness and a PID on the motor at once."""

    target = Ref("vsajax.control:Combined")
    type: Literal["combined"]
    stiffness: Annotated[Part, STIFFNESSES]
    motor: MotorPID


class BangBangPosition(Part):
    """Stops the link by moving the motor to it, then brings it back."""

    target = Ref("vsajax.control:BangBangPosition")
    type: Literal["bang_bang"]
    stiffness: Positive
    return_time: Positive
    tolerance: Positive
    lead: float = 0.0
    most_stops: Positive = 6.0


CONTROLLERS = STIFFNESSES.of(
    ConstantStiffness, StiffnessSwitch, SmoothStiffness, PIDPosition, BangBangPosition, Combined
)
Controller = Annotated[Part, CONTROLLERS]


class SwingScorer(Part):
    """How coming to rest is judged."""

    target = Ref("vsajax.scores:SwingScorer")
    band: Positive = 0.05
