import math
from pathlib import Path

import numpy as np
import pytest

from tuning.files.errors import InputError
from tuning.logs.signal_map import KINDS, Angle, Clock, Signals, Torque, canonical_map, read_signal_map, signals_of

LOG_MAPS = sorted((Path(__file__).resolve().parents[3] / "configs" / "logs").glob("*.toml"))

SEA_MAP = """
schema_version = 1
kind = "sea"
[clock]
column = "t"
unit = "s"
[signals.deflection]
column = "d"
unit = "rad"
[signals.elastic_torque]
column = "f"
unit = "N.m"
"""


def mistakes_of(tmp_path: Path, text: str) -> str:
    path = tmp_path / "map.toml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        read_signal_map(path)
    assert all(mistake.place.startswith(str(path)) for mistake in caught.value.mistakes)
    return str(caught.value)


@pytest.mark.contract
@pytest.mark.parametrize("path", LOG_MAPS, ids=lambda path: path.stem)
def test_every_shipped_map_is_valid(path):
    assert read_signal_map(path).signals.given()


@pytest.mark.contract
def test_the_shipped_maps_were_found():
    assert {"hebi", "sea_tregear", "sea_tregear_csv"} <= {path.stem for path in LOG_MAPS}


@pytest.mark.contract
@pytest.mark.parametrize("kind", KINDS)
def test_every_signal_of_a_kind_can_be_mapped_and_read_canonically(kind):
    assert set(signals_of(kind)) <= set(Signals.model_fields)
    whole = canonical_map(kind, set(signals_of(kind)))
    values = np.array([0.1, -1e-300, 1e300])
    assert set(whole.signals.given()) == set(signals_of(kind))
    for signal in whole.signals.given().values():
        np.testing.assert_array_equal(signal.to_si(values), values)


@pytest.mark.analytic
@pytest.mark.parametrize(
    ("signal", "reading", "si"),
    [
        (Angle(column="a", unit="deg"), 180.0, math.pi),
        (Angle(column="a", unit="rev"), 0.25, math.pi / 2),
        (Angle(column="a", unit="mrad"), 5.0, 5e-3),
        (Angle(column="a", unit="counts", counts_per_revolution=4096), 1024, math.pi / 2),
        (Angle(column="a", unit="counts", counts_per_revolution=4096, offset=512), 512, 0.0),
        (Angle(column="a", unit="deg", offset=90, sign=-1), 0.0, math.pi / 2),
        (Angle(column="a", unit="rad", gear_ratio=100), 50.0, 0.5),
        (Angle(column="a", unit="V", scale=0.2, offset=2.5), 5.0, 0.5),
        (Torque(column="a", unit="mN.m"), 250.0, 0.25),
        (Torque(column="a", unit="N.cm"), 250.0, 2.5),
        (Torque(column="a", unit="A", scale=0.05, gear_ratio=100), 2.0, 10.0),
        (Torque(column="a", unit="mA", scale=0.05, gear_ratio=100, sign=-1), 2000.0, -10.0),
        (Torque(column="a", unit="V", scale=10.0, offset=2.5), 3.0, 5.0),
    ],
)
def test_a_reading_becomes_si(signal, reading, si):
    np.testing.assert_allclose(signal.to_si(np.array([reading])), [si], rtol=1e-15)


@pytest.mark.analytic
def test_stiffness_per_degree_becomes_per_radian():
    signals = Signals.model_validate({"true_stiffness": {"column": "k", "unit": "N.m/deg"}})
    assert signals.true_stiffness is not None
    np.testing.assert_allclose(signals.true_stiffness.to_si(np.array([math.pi])), [180.0], rtol=1e-15)


@pytest.mark.analytic
def test_a_wrapping_encoder_is_unwrapped_before_its_offset_is_taken():
    turns = np.linspace(0.0, 3.0, 40)
    reading = np.mod(360.0 * turns + 300.0, 360.0)
    encoder = Angle(column="a", unit="deg", wraps_at=360, offset=300, sign=-1, gear_ratio=2)
    np.testing.assert_allclose(encoder.to_si(reading), -math.pi * turns, atol=1e-12)
    assert encoder.count_wraps(reading) == 3
    assert encoder.wrap_problem(reading) is None
    assert "more than wraps_at = 180" in str(Angle(column="a", unit="deg", wraps_at=180).wrap_problem(reading))


@pytest.mark.analytic
def test_nanoseconds_since_1970_keep_every_nanosecond():
    stamps = 1_700_000_000_000_000_000 + np.array([0, 1, 1_000_001])
    np.testing.assert_array_equal(Clock(column="t", unit="ns").to_seconds(stamps), [0.0, 1e-9, 1.000001e-3])


@pytest.mark.failure
@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('kind = "sea"', 'kind = "spring"', ["kind", "'spring'", "'serial', 'antagonistic' or 'sea'"]),
        ("schema_version = 1", "schema_version = 2", ["schema_version", "got 2"]),
        ("schema_version = 1", "", ["schema_version", "missing"]),
        ('unit = "s"', 'unit = "min"', ["clock.unit", "'min'", "'us'"]),
        ('unit = "s"', 'unit = "s"\ndrop_duplicate = true', ["clock.drop_duplicate", "drop_duplicates?"]),
        ("[signals.deflection]", "[signals.deflexion]", ["signals.deflexion", "did you mean deflection"]),
        ('unit = "rad"', 'unit = "N.m"', ["signals.deflection.unit", "'N.m'", "'rad'", "'counts'"]),
        ('unit = "N.m"', 'unit = "deg"', ["signals.elastic_torque.unit", "'deg'", "'mN.m'"]),
        ('unit = "rad"', 'unit = "rad"\nsign = 2', ["signals.deflection.sign", "got 2", "1 or -1"]),
        ('unit = "rad"', 'unit = "rad"\ngear_ratio = 0', ["signals.deflection.gear_ratio", "greater than 0"]),
        ('unit = "rad"', 'unit = "rad"\nwraps_at = -1', ["signals.deflection.wraps_at", "greater than 0"]),
        ('unit = "rad"', 'unit = "rad"\noffset = nan', ["signals.deflection.offset", "finite"]),
        ('unit = "rad"', 'unit = "rad"\noffset = "3"', ["signals.deflection.offset", "number"]),
        ('unit = "rad"', 'unit = "rad"\nscale = 0', ["signals.deflection.scale", "erases"]),
        ('unit = "rad"', 'unit = "counts"', ["signals.deflection", "counts_per_revolution"]),
        ('unit = "rad"', 'unit = "rad"\ncounts_per_revolution = 8', ["signals.deflection", "not with 'rad'"]),
        ('unit = "rad"', 'unit = "V"', ["signals.deflection", "needs scale", "rad per V"]),
        ('unit = "N.m"', 'unit = "mA"', ["signals.elastic_torque", "needs scale", "N.m per A"]),
        ('unit = "N.m"', 'unit = "N.m"\nwraps_at = 3', ["signals.elastic_torque.wraps_at", "unknown key"]),
        ('kind = "sea"', 'kind = "sea"\nselect = { run = [1] }', ["select", "run = [1]", "neither a string"]),
        (
            'kind = "sea"',
            'kind = "antagonistic"',
            ["signals.deflection does not belong", "needs motor1_position", "needs motor2_torque"],
        ),
        (
            "[signals.deflection]",
            "[signals.link_position]",
            ["needs deflection (or link_position and motor_"],
        ),
    ],
)
def test_a_mistake_in_a_map_is_named(tmp_path, old, new, said):
    assert old in SEA_MAP
    text = mistakes_of(tmp_path, SEA_MAP.replace(old, new, 1))
    for words in said:
        assert words in text


@pytest.mark.failure
def test_all_mistakes_of_a_map_come_together(tmp_path):
    text = mistakes_of(
        tmp_path, SEA_MAP.replace('"s"', '"min"').replace('"rad"', '"radian"').replace("= 1", "= 9")
    )
    for key in ("schema_version", "clock.unit", "signals.deflection.unit"):
        assert key in text


@pytest.mark.failure
def test_motor_torque_takes_no_gear_ratio(tmp_path):
    # The residual observer multiplies by its own gear ratio: twice is a stiffness wrong by γ.
    path = tmp_path / "map.toml"
    path.write_text(
        'schema_version = 1\nkind = "sea"\nclock = { column = "t", unit = "s" }\n'
        '[signals]\ndeflection = { column = "d", unit = "rad" }\n'
        'motor_torque = { column = "i", unit = "A", scale = 0.05, gear_ratio = 50.0 }\n'
    )
    with pytest.raises(InputError, match=r"signals\.motor_torque\.gear_ratio must stay out.*torque\.gear_ratio"):
        read_signal_map(path)
