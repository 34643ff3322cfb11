"""Every table of a study against the class of vsajax that it describes."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import vsajax
from tuning.files.whole import write_table
from tuning.problem.build import build
from tuning.study.parts import base, estimators, joints, rig, springs, swings
from tuning.study.parts.base import Part
from tuning.study.parts.catalog import SLOTS
from tuning.testing import check_part

LINK, MOTOR = {"inertia": 0.1, "damping": 0.2}, {"inertia": 1e-4, "damping": 1e-3}
SPRING = {"type": "linear", "rate": 10.0}
RANGE = {"soft": 0.3, "stiff": 1.0}
PID = {"proportional": 1.0, "integral": 2.0, "derivative": 3.0}
SPRINGS = {"spring1": SPRING, "spring2": SPRING}
BASIS, FIT = {"type": "polynomial"}, {"prior_scale": 2.0}
SIDE = {"torque": {"type": "sensor"}, "basis": BASIS, "fit": FIT}
RESIDUAL = {"type": "residual", "observer_gain": 3.0, "motor_inertia": 1e-4, "motor_damping": 1e-3}
OBSERVER = {
    "type": "algebraic",
    "motor_inertia": 1e-4,
    "motor_damping": 1e-3,
    # Not whole in samples: there the derivative in the window has a jump.
    "window": 0.0203,
    "longest_window": 0.03,
    "sample_time": 1e-3,
    "basis": BASIS,
    # Its integrals over the window are of 1e-8: with a prior as narrow as the others' all answers are rounding.
    "fit": {"prior_scale": 1e14},
}

# What each table needs at least.
MINIMAL = {
    rig.Sine: {"type": "sine", "amplitude": 1.0, "frequency": 2.0},
    rig.Multisine: {"type": "multisine", "amplitudes": [1.0], "frequencies": [2.0], "phases": [3.0]},
    rig.Chirp: {"type": "chirp", "amplitude": 1.0, "start": 2.0, "stop": 3.0, "duration": 4.0},
    rig.BandLimitedNoise: {"type": "noise", "std": 1.0, "low": 2.0, "high": 3.0, "tones": 3},
    rig.Excitation: {},
    rig.Encoder: {"counts_per_revolution": 1000.0},
    rig.Sensor: {},
    rig.Sensing: {},
    rig.Clock: {"sample_time": 0.1, "duration": 1.0},
    rig.Scorer: {},
    swings.SingleLink: {"link": LINK},
    swings.StiffnessActuator: RANGE,
    swings.PositionMotor: {"time_constant": 0.03, "top_speed": 6.0},
    swings.SwitchedPlant: {"mechanism": {"link": LINK}, "actuator": RANGE},
    swings.Pulse: {"torque": 1.0, "duration": 0.05},
    swings.Impact: {"impulse": 0.1},
    swings.FeedbackSensor: {},
    swings.SwingObserver: {},
    swings.Conic: {},
    swings.TimeLead: {"type": "lead", "position_lead": 0.1, "velocity_lead": 0.2},
    swings.FixedThresholds: {"type": "thresholds", "position": 0.1, "velocity": 0.2},
    swings.RelativeThresholds: {"type": "relative", "position_share": 0.1, "velocity_share": 0.2},
    swings.DelayedRelease: {"type": "release", "share": 0.1},
    swings.Hold: {},
    swings.ConstantStiffness: {"type": "constant", "stiffness": 0.5},
    swings.StiffnessSwitch: {"type": "switch", **RANGE},
    swings.SmoothStiffness: {"type": "smooth", **RANGE, "sharpness": 3.0, "rate": 14.0},
    swings.PIDPosition: {
        "type": "pid",
        "stiffness": 0.5,
        **PID,
    },
    swings.MotorPID: PID,
    swings.Combined: {"type": "combined", "stiffness": {"type": "switch", **RANGE}, "motor": PID},
    swings.BangBangPosition: {"type": "bang_bang", "stiffness": 0.5, "return_time": 0.6, "tolerance": 0.02},
    swings.SwingScorer: {},
    estimators.SensorTorque: {"type": "sensor"},
    estimators.ModelTorque: {"type": "model", "law": SPRING},
    estimators.ResidualTorque: RESIDUAL,
    estimators.FiniteDifference: {"type": "difference"},
    estimators.KinematicKalman: {"type": "kalman", "acceleration_variance": 1e4, "reading_variance": 0.1},
    estimators.ModifiedKinematicKalman: {"type": "mkkf", "acceleration_variance": 1e4},
    estimators.SeparableOddPolynomial: {"type": "odd"},
    estimators.Polynomial: {"type": "polynomial"},
    estimators.Legendre: {"type": "legendre", "lower": -0.1, "upper": 0.2},
    estimators.Taylor: {"type": "taylor"},
    estimators.UnitFactor: {},
    estimators.EnhancedFactor: {"type": "enhanced", "constant": 1e-20},
    estimators.ConstantFactor: {"type": "constant", "factor": 0.5},
    estimators.ExponentialForgetting: {"type": "forgetting", "forgetting": 0.9},
    estimators.RecursiveLeastSquares: FIT,
    estimators.ExcitationGate: {},
    estimators.StiffnessEstimator: SIDE,
    estimators.AlgebraicObserver: OBSERVER,
    estimators.AntagonisticPair: {"type": "pair", "side": SIDE | {"torque": RESIDUAL}},
    joints.CoulombFriction: {"torque": 0.1},
    joints.Link: LINK,
    joints.Motor: MOTOR,
    joints.SerialJoint: {"link": LINK, "motor": MOTOR, "setpoint_motor": MOTOR, "spring": SPRING},
    joints.FlexibleJoint: {"link": LINK, "motor": MOTOR, "spring": SPRING},
    joints.AntagonisticJoint: {
        "link": LINK,
        "motor1": MOTOR,
        "motor2": MOTOR,
        "spring1": SPRING,
        "spring2": SPRING,
    },
    springs.LinearSpring: SPRING,
    springs.CubicSpring: {"type": "cubic", "linear": 10.0, "cubic": 20.0},
    springs.PolynomialSpring: {"type": "polynomial", "coefficients": [1.0, 2.0]},
    springs.ExponentialSpring: {"type": "exponential", "torque_scale": 1.0, "exponent": 2.0},
    springs.HyperbolicSpring: {"type": "hyperbolic", "torque_scale": 1.0, "exponent": 2.0},
    springs.LeverSpring: {"type": "lever", "spring_rate": 1e4, "arm": 0.1, "pitch": 4e-4},
}
each_part = pytest.mark.parametrize("part", MINIMAL, ids=lambda part: part.__name__)


def every_part(root: type[Part] = Part) -> set[type[Part]]:
    return {part for child in root.__subclasses__() for part in {child, *every_part(child)}}


@pytest.mark.contract
def test_no_part_is_left_out():
    ours = {part for part in every_part() if "target" in vars(part) and part.__module__.startswith("tuning.")}
    # A recorded torque reads its file when it is built; it has a test of its own.
    assert ours == {*MINIMAL, rig.RecordedTorque}
    assert all(part.__module__.startswith(base.__package__) for part in MINIMAL)
    assert {slot for _, slot in SLOTS.items() for part in slot.own().values() if part not in ours} == set()


@pytest.mark.contract
@pytest.mark.parametrize(
    "part",
    [
        # Both are traced for seconds; they have all that the two-stage estimator has.
        pytest.param(part, marks=pytest.mark.slow)
        if part in {estimators.AlgebraicObserver, estimators.AntagonisticPair}
        else part
        for part in MINIMAL
    ],
    ids=lambda part: part.__name__,
)
def test_a_part_keeps_the_contract_that_those_of_others_are_held_to(part):
    check_part(part, MINIMAL[part])


@pytest.mark.contract
def test_a_recorded_torque_is_read_from_its_file(tmp_path):
    path = tmp_path / "torque.csv"
    columns = {"time": np.array([0.0, 0.1, 0.3]), "motor_torque": np.array([1.0, -2.0, 0.5])}
    write_table(path, columns)
    built = build(rig.RecordedTorque(type="file", path=str(path)))
    assert type(built) is vsajax.sensing.Recorded
    np.testing.assert_array_equal(built.time, columns["time"])
    np.testing.assert_array_equal(built.torque, columns["motor_torque"])


TORQUES = [MINIMAL[part] for part in (estimators.SensorTorque, estimators.ModelTorque, estimators.ResidualTorque)]
BASES = [
    {"type": "odd", "setpoint_terms": 1},
    {"type": "odd", "setpoint_terms": 2},
    {"type": "polynomial"},
    MINIMAL[estimators.Legendre],
]


SIDES = [
    {"torque": torque, "basis": basis, "fit": FIT, "deflection": deflection}
    for torque, basis, deflection in itertools.product(TORQUES, BASES, ["filtered", "raw", "measured"])
]
OBSERVERS = [OBSERVER | {"basis": basis} for basis in BASES]
PAIRS = [{"type": "pair", "side": side} for side in SIDES[::5]]
PAIRS += [
    {"type": "pair", "side": side, "other": observer}
    for side, observer in itertools.product(SIDES[::7], OBSERVERS)
]


@pytest.mark.contract
def test_the_table_and_the_estimator_need_the_same_signals_and_all_can_be_sensed():
    everything = set()
    for part, tables in {
        estimators.StiffnessEstimator: SIDES,
        estimators.AlgebraicObserver: OBSERVERS,
        estimators.AntagonisticPair: PAIRS,
    }.items():
        for values in tables:
            table = part.model_validate(values)
            assert table.needs == build(table).needs, values
            everything |= table.needs
    # All of them are asked for by one combination or another.
    assert everything == rig.Sensing.model_fields.keys()


@pytest.mark.contract
def test_what_is_no_table_is_built_as_it_is():
    assert build(3.0) == 3.0
    assert build(None) is None
    assert build("nearest") == "nearest"
