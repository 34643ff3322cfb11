"""A sweep in chunks: the same rows as a sweep in one go, and none computed twice."""

from __future__ import annotations

import math

import numpy as np
import pyarrow as pa
import pytest

from tests.tuning.builders import NOISE, PRIOR, tiny_serial
from tuning.files.errors import InputError
from tuning.scoring import sweep as sweep_module
from tuning.scoring.sweep import GridSweep, plan_sweep, rank
from tuning.study.structures import with_grid

AXES = {NOISE: [0.01, 0.03], PRIOR: [0.1, 0.3, 1.0, 3.0, 10.0]}
SCENARIOS = 2
ONE_POINT = 2 * SCENARIOS * 201
"""Lane-steps of one outer point: noise levels × scenarios × samples."""


def in_chunks_of(points: int, monkeypatch) -> GridSweep:
    monkeypatch.setattr(sweep_module, "_STEPS_PER_CHUNK", points * ONE_POINT)
    planned = GridSweep(tiny_serial("scorer.warm_up=0.1"), AXES, SCENARIOS)
    assert planned.points_per_chunk == points
    return planned


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> tuple[GridSweep, pa.Table]:
    """A sweep in two chunks, the second of which is filled up, and its results."""
    with pytest.MonkeyPatch.context() as patch:
        planned = in_chunks_of(3, patch)
        return planned, planned.run(planned.open(tmp_path_factory.mktemp("whole") / "run", resume=False))


@pytest.mark.equivalence
def test_results_have_one_row_a_configuration_and_scenario(whole):
    planned, table = whole
    assert planned.chunks == ["000000", "000001"]
    assert table.num_rows == 10 * SCENARIOS
    assert {"configuration", "scenario", NOISE, PRIOR, "msrep", "convergence_time", "diverged"} <= set(
        table.column_names
    )
    rows = table.to_pylist()
    assert sorted((row["configuration"], row["scenario"]) for row in rows) == [
        (n, s) for n in range(10) for s in range(SCENARIOS)
    ]
    for row in rows:
        assert {path: row[path] for path in AXES} == planned.structures[0].grid.values_of(row["configuration"])
    scores = planned.structures[0].grid.evaluate(planned.structures[0].grid.outer_points)["msrep"]
    for row in rows:
        ((point,), (inner,)) = np.nonzero(planned.structures[0].grid.configuration_of == row["configuration"])
        # The same program on five points instead of three.
        np.testing.assert_allclose(row["msrep"], scores[point, inner, row["scenario"]], rtol=1e-11)


@pytest.mark.equivalence
def test_results_do_not_depend_on_the_size_of_chunks(whole, monkeypatch, tmp_path):
    _, table = whole
    single = in_chunks_of(1, monkeypatch)
    other = single.run(single.open(tmp_path / "run", resume=False))
    assert len(single.chunks) == 5
    assert other.column_names == table.column_names
    for name in table.column_names:
        np.testing.assert_allclose(other[name].to_numpy(), table[name].to_numpy(), rtol=1e-11, err_msg=name)


@pytest.mark.equivalence
def test_a_run_that_was_cut_off_goes_on_to_the_same_bytes_and_computes_only_what_is_missing(
    whole, monkeypatch, tmp_path
):
    planned, _ = whole
    straight = planned.open(tmp_path / "straight", resume=False)
    planned.run(straight)
    asked = []

    def run_chunk(self, chunk, original=GridSweep.run_chunk):
        asked.append(chunk)
        if len(asked) == 2:
            raise KeyboardInterrupt
        return original(self, chunk)

    monkeypatch.setattr(GridSweep, "run_chunk", run_chunk)
    with pytest.raises(KeyboardInterrupt):
        planned.run(planned.open(tmp_path / "cut", resume=False))
    assert not (tmp_path / "cut" / "results.parquet").exists()
    planned.run(planned.open(tmp_path / "cut", resume=True))
    assert asked == ["000000", "000001", "000001"]
    for name in ("results.parquet", "chunks/000000.parquet", "chunks/000001.parquet"):
        assert (tmp_path / "cut" / name).read_bytes() == (tmp_path / "straight" / name).read_bytes()
    planned.run(planned.open(tmp_path / "cut", resume=True))
    assert len(asked) == 3


def test_a_forecast_is_of_the_whole_sweep(whole):
    planned, _ = whole
    forecast = planned.forecast()
    assert forecast.chunks == 2
    # This process with jax in it holds more than 100 MB; the results of 20 rows add next to nothing.
    assert 1e8 < forecast.memory < 1e11
    assert 0.0 < forecast.run_time < 60.0
    assert math.isfinite(forecast.compile_time)


@pytest.mark.failure
def test_a_sweep_without_axes_is_refused():
    with pytest.raises(InputError, match=r"study\.toml: sweep\.grid: has no axis\n.*--grid estimator"):
        plan_sweep(tiny_serial(), "study.toml")


def test_the_grid_of_the_command_line_replaces_the_studys():
    study = tiny_serial("sweep.scenarios=9", f"sweep.grid={{ '{NOISE}' = [1.0, 2.0] }}")
    planned = plan_sweep(with_grid(study, [], None), "here")
    assert (planned.axes, planned.scenarios) == ({NOISE: [1.0, 2.0]}, 9)
    planned = plan_sweep(with_grid(study, [f"{PRIOR}=lin(1,3,3)"], 4), "here")
    assert (planned.axes, planned.scenarios) == ({PRIOR: [1.0, 2.0, 3.0]}, 4)


def test_configurations_are_ranked_by_their_mean_and_diverged_ones_last():
    scores = {0: [3.0, 5.0], 1: [math.nan, 0.1], 2: [1.0, 2.0], 3: [math.inf, 0.0]}
    order = [(2, 1), (0, 0), (1, 1), (3, 0), (0, 1), (2, 0), (1, 0), (3, 1)]
    table = pa.table(
        {
            "configuration": [n for n, _ in order],
            "scenario": [s for _, s in order],
            PRIOR: [10.0 * n for n, _ in order],
            "msrep": [scores[n][s] for n, s in order],
        }
    )
    rows = rank(table, [PRIOR], "msrep")
    assert [row["configuration"] for row in rows] == [2, 0, 1, 3]
    # The 90 % quantile of 1 and 2 lies nine tenths of the way between them.
    best = {"configuration": 2, PRIOR: 20.0, "mean": 1.5, "median": 1.5, "q90": pytest.approx(1.9)}
    assert rows[0] == best | {"diverged": 0}
    assert [row["diverged"] for row in rows] == [0, 0, 1, 1]
    assert all(math.isnan(row["mean"]) for row in rows[2:])
