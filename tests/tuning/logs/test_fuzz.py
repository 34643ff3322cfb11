"""Logs and files mangled at random: never a traceback, never a silent answer where something listed is wrong."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.tuning.logs.robot_logs import MAP, STEP, look_at, names, spring_log, with_gap, wrapped, write_spring_log
from tuning.files.errors import InputError
from tuning.files.shipped import CONFIGS
from tuning.files.toml import read_toml
from tuning.logs.formats import read_streams
from tuning.logs.signal_map import read_signal_map
from tuning.study.loading import load_config, load_study

FEW, MANY = 60, 7000
DEGREES = 180.0 / np.pi
STUDIES = sorted(
    [*CONFIGS.glob("studies/*.toml"), *CONFIGS.glob("tuned/*.toml"), *CONFIGS.glob("log_studies/*.toml")]
)
MAPS = sorted(CONFIGS.glob("logs/*.toml"))
VALUES = ["-1", "0", "1e400", "nan", '"x"', "[]", "{}", "true", "1e308", "[1, 2]", "-0.0", "{a = 1}"]

seeds = st.integers(0, 2**32 - 1)
suffixes = st.sampled_from([".csv", ".parquet"])


def cases(*strategies):
    """Return what makes a test of drawn values one at two sizes: a few by default, thousands in the slow tests."""
    common = {"deadline": None, "suppress_health_check": list(HealthCheck), "database": None}

    def sized(test):
        @pytest.mark.parametrize("count", [FEW, pytest.param(MANY, marks=pytest.mark.slow)], ids=["few", "many"])
        def run(count):
            # Anew for each size: what hypothesis has decorated once keeps its settings.
            settings(max_examples=count, **common)(given(*strategies)(test))()

        run.__name__ = test.__name__
        return run

    return sized


@cases(seeds, st.floats(0.02, 0.3), st.data())
def test_no_mutation_of_those_listed_passes_silently(seed, amplitude, data):
    columns = spring_log(seed=seed, amplitude=amplitude, samples=data.draw(st.integers(200, 500)))
    kind = data.draw(st.sampled_from(["gap", "sign", "degrees", "wrap", "truncated", "none"]))
    with tempfile.TemporaryDirectory() as name:
        folder, suffix = Path(name), data.draw(suffixes)
        if kind == "gap":
            place = data.draw(st.integers(0, len(columns["time"]) - 2))
            length = data.draw(st.floats(0.3, 5.0))
            table, _ = look_at(write_spring_log(folder, with_gap(columns, place, length), suffix))
            assert any(gap.length == pytest.approx(length, abs=1e-6) for gap in table.clock.gaps)
            assert any("largest gap" in note for note in table.notes)
        elif kind == "sign":
            signal = data.draw(st.sampled_from(["torque", "deflection", "motor"]))
            _, analysis = look_at(write_spring_log(folder, columns | {signal: -columns[signal]}, suffix))
            assert "swapped sign" in names(analysis)
        elif kind == "degrees":
            every = [("link", "motor", "deflection"), ("deflection",), ("link",), ("motor",)]
            columns |= {signal: DEGREES * columns[signal] for signal in data.draw(st.sampled_from(every))}
            _, analysis = look_at(write_spring_log(folder, columns, suffix))
            assert "degrees for radians" in names(analysis)
        elif kind == "wrap":
            period = data.draw(st.sampled_from([2 * np.pi, np.pi]))
            turned = wrapped(columns["link"] - float(np.median(columns["link"])) + period / 2, period)
            _, analysis = look_at(write_spring_log(folder, columns | {"link": turned}, suffix))
            assert "wrapped encoder" in names(analysis)
        elif kind == "truncated":
            path = write_spring_log(folder, columns, ".parquet")
            content = path.read_bytes()
            path.write_bytes(content[: data.draw(st.integers(1, len(content) - 1))])
            with pytest.raises(InputError):
                look_at(path)
        else:
            table, analysis = look_at(write_spring_log(folder, columns, suffix))
            assert analysis.faults == ()
            assert table.clock.gaps == ()
            assert table.clock.median == pytest.approx(STEP, rel=0.1)


def refusal(action: Callable[[], object]) -> str | None:
    """Return what an action is refused with, or `None` if it is done; any other error is the test's."""
    try:
        action()
    except InputError as error:
        return str(error)
    return None


def _read(path: Path) -> None:
    assert read_streams(path)
    if path.suffix in (".csv", ".parquet"):
        table, _ = look_at(path)
        assert all(np.isfinite(values).all() for values in table.columns.values())


def _files() -> dict[str, bytes]:
    """Return a small good file of every format."""
    import h5py
    import scipy.io

    columns = spring_log(samples=60)
    found = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for suffix in (".csv", ".parquet"):
            found[suffix] = write_spring_log(folder, columns, suffix).read_bytes()
        scipy.io.savemat(folder / "log.mat", {"log": columns, "spring": np.stack(list(columns.values()), 1)})
        found[".mat"] = (folder / "log.mat").read_bytes()
        with h5py.File(folder / "log.h5", "w") as file:
            for key, values in columns.items():
                file[key] = values
        found[".h5"] = (folder / "log.h5").read_bytes()
    return found


FILES = _files()


@cases(st.sampled_from([".csv", ".parquet", ".h5"]), st.data())
def test_a_mangled_file_is_read_or_refused_but_never_a_traceback(suffix, data):
    content = bytearray(FILES[suffix])
    match data.draw(st.sampled_from(["cut", "flip", "insert", "noise"])):
        case "cut":
            del content[data.draw(st.integers(0, len(content))) :]
        case "flip":
            for _ in range(data.draw(st.integers(1, 20))):
                content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
        case "insert":
            place = data.draw(st.integers(0, len(content)))
            content[place:place] = data.draw(st.binary(min_size=1, max_size=40))
        case _:
            content = bytearray(data.draw(st.binary(max_size=200)))
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / f"log{suffix}"
        path.write_bytes(bytes(content))
        (path.parent / "map.toml").write_text(MAP.format(link="", torque=""))
        said = refusal(lambda: _read(path))
        assert said is None or path.name in said or "map.toml" in said


@cases(st.sampled_from(STUDIES + MAPS), st.data())
def test_a_mangled_study_or_map_is_read_or_refused_with_its_place(path, data):
    lines = path.read_text(encoding="utf-8").splitlines()
    for _ in range(data.draw(st.integers(1, 3))):
        place = data.draw(st.integers(0, len(lines) - 1))
        match data.draw(st.sampled_from(["drop", "double", "value", "key", "junk", "cut"])):
            case "drop":
                del lines[place]
            case "double":
                lines.insert(place, lines[place])
            case "value":
                key, equals, _ = lines[place].partition("=")
                values = [
                    "-1",
                    "0",
                    "1e400",
                    "nan",
                    '"x"',
                    "[]",
                    "{}",
                    "true",
                    "1e308",
                    "[1, 2]",
                    "-0.0",
                    "{a = 1}",
                ]
                lines[place] = f"{key}= {data.draw(st.sampled_from(values))}" if equals else lines[place]
            case "key":
                lines[place] = lines[place].replace("e", data.draw(st.sampled_from(["", "x", ".", '"'])), 1)
            case "junk":
                lines[place] = data.draw(st.text(max_size=20).filter(lambda t: "\ud800" not in t))
            case _:
                del lines[place:]
        if not lines:
            break
    with tempfile.TemporaryDirectory() as name:
        mangled = Path(name) / "mangled.toml"
        mangled.write_text("\n".join(lines), encoding="utf-8", errors="replace")
        said = refusal(lambda: _load(mangled, is_map=path in MAPS))
        assert said is None or mangled.name in said


def _load(path: Path, *, is_map: bool) -> object:
    if is_map:
        return read_signal_map(path)
    return load_study(path) if "recording" in read_toml(path) else load_config(path)


def test_a_mangled_matlab_file_is_read_or_refused_even_where_its_parser_crashes(tmp_path):
    # Read in a process of its own, at some tenths of a second each: a few of them.
    rng = np.random.default_rng(8)
    path = tmp_path / "log.mat"
    for _ in range(3):
        content = bytearray(FILES[".mat"])
        for place in rng.integers(0, len(content), 12):
            content[place] = rng.integers(0, 256)
        path.write_bytes(bytes(content))
        said = refusal(lambda: _read(path))
        assert said is None or path.name in said
