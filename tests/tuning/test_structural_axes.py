"""Grids over what is no number: texts, switches and whole numbers, each a program, in one table of results."""

from __future__ import annotations

import json

import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.tuning.builders import PRIOR, SERIAL, SMALL, tiny_serial
from tuning.files.errors import InputError
from tuning.report.pictures.searches import draw_sweep
from tuning.scoring.sweep import plan_sweep
from tuning.study.base import study_hash
from tuning.study.loading import load_study
from tuning.study.paths import structural_paths
from tuning.study.structures import grid_structures, with_grid

GAIN, TYPE = "estimator.torque.observer_gain", "estimator.torque.type"
TERMS, MATCHED = "estimator.basis.deflection_terms", "estimator.matched"
VELOCITY = "estimator.velocity={type='difference'}"
BASIS = "estimator.basis={type='odd'}"
GRIDS = (f"{TYPE}=residual,sensor", f"{GAIN}=100,300", f"{TERMS}=2", f"{PRIOR}=0.1,1")


def swept(*grids: str):
    return plan_sweep(with_grid(load_study(SERIAL, [*SMALL, VELOCITY, BASIS]), grids, 2), "here")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Return a sweep over both kinds of axes, and its table."""
    planned = swept(*GRIDS)
    folder = tmp_path_factory.mktemp("sweep")
    return planned, planned.run(planned.open(folder / "run", resume=False), quiet=True)


@pytest.mark.equivalence
def test_every_structure_scores_as_it_does_alone(run):
    planned, table = run
    rows = table.to_pylist()
    # Two gains × two priors by the residual; the sensor has no gain: priors alone.
    assert planned.configurations == 4 + 2
    assert len(rows) == 2 * 6
    assert len({row["configuration"] for row in rows}) == 6
    for kind in ("residual", "sensor"):
        own = [VELOCITY, BASIS, f"{TERMS}=2"]
        own += ["estimator.torque={type='sensor'}"] if kind == "sensor" else []
        alone = plan_sweep(with_grid(load_study(SERIAL, [*SMALL, *own]), [f"{PRIOR}=0.1,1"], 2), "here")
        expected = alone.run_chunk("000000")["msrep"]
        found = [row["msrep"] for row in rows if row[TYPE] == kind and (kind == "sensor" or row[GAIN] == 300.0)]
        np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_columns_have_their_own_types_and_nan_where_a_number_does_not_exist(run):
    _, table = run
    assert [str(table.schema.field(path).type) for path in (TYPE, TERMS, GAIN)] == ["string", "int64", "double"]
    gains, kinds = table[GAIN].to_numpy(), np.array(table[TYPE].to_pylist())
    np.testing.assert_array_equal(np.isnan(gains), kinds == "sensor")


@pytest.mark.equivalence
def test_a_sweep_over_settings_resumes_to_the_same(run, tmp_path):
    planned, whole = run
    store = planned.open(tmp_path / "run", resume=False)
    store.write_chunk(planned.chunks[1], planned.run_chunk(planned.chunks[1]))
    again = planned.open(tmp_path / "run", resume=True)
    assert list(again.pending()) == planned.chunks[:1]
    resumed = planned.run(again, quiet=True)
    assert resumed.schema == whole.schema
    for name in whole.column_names:
        np.testing.assert_array_equal(resumed[name].to_numpy(), whole[name].to_numpy(), err_msg=name)


@pytest.mark.cli
def test_the_command_ranks_draws_reports_and_leaves_a_study_that_is_whole(vsajax, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = [word for setting in (*SMALL, VELOCITY, BASIS) for word in ("--set", setting)]
    grids = [word for grid in (f"{TYPE}=residual,sensor", f"{MATCHED}=true,false") for word in ("--grid", grid)]
    ended = vsajax("sweep", SERIAL, "-o", "run", "--scenarios", "2", *words, *grids, "--json")
    assert (ended.code, ended.err) == (0, "")
    said = json.loads(ended.out)
    best = said["best"][0]
    assert len(said["best"]) == 4
    assert best[TYPE] == "sensor"
    assert type(best[MATCHED]) is bool
    winner = load_study(tmp_path / "run" / "best.toml")
    assert structural_paths(winner)[TYPE] == "sensor"
    assert structural_paths(winner)[MATCHED] == best[MATCHED]
    text = vsajax("sweep", SERIAL, "-o", "run", "--scenarios", "2", *words, *grids, "--resume").out
    assert "sensor" in text
    assert vsajax("report", "run", "-o", "page.html").code == 0
    assert "sensor" in (tmp_path / "page.html").read_text()
    table = pq.read_table(tmp_path / "run" / "results.parquet")
    assert str(table.schema.field(MATCHED).type) == "bool"


@pytest.mark.parametrize("axes", [{TYPE: ["residual", "sensor"]}, {TYPE: ["a", "b"], TERMS: [2, 4, 6]}])
def test_settings_are_ticks_with_their_names(axes):
    count = int(np.prod([len(values) for values in axes.values()]))
    figure = draw_sweep([{"configuration": i, "mean": 1.0 + i} for i in range(count)], axes, "msrep")
    words = {
        tick.get_text() for axis in figure.axes for tick in (*axis.get_xticklabels(), *axis.get_yticklabels())
    }
    assert {str(value) for values in axes.values() for value in values} <= words


def test_a_study_may_list_settings_itself_and_an_axis_of_numbers_keeps_its_hash():
    grid = f"sweep.grid={{ '{TERMS}' = [1, 2], '{MATCHED}' = [true, false] }}"
    study = tiny_serial(grid)
    assert [chosen for chosen, _ in grid_structures(study, "here")] == [
        {TERMS: terms, MATCHED: matched} for terms in (1, 2) for matched in (True, False)
    ]
    numbers = tiny_serial(f"sweep.grid={{ '{PRIOR}' = [1.0, 2.0] }}")
    assert "options" not in json.dumps(numbers.model_dump(exclude_none=True))
    assert study_hash(study) != study_hash(numbers)


@pytest.mark.failure
@pytest.mark.parametrize(
    ("grid", "said"),
    [
        (f"{TYPE}=residual,sensr", r"estimator.torque.type = sensr\): .* got 'sensr'; allowed: 'sensor', 'model'"),
        (f"{TYPE}=1,2", "got numbers; needs options as 'residual' is"),
        (f"{TERMS}=2,2.5", "got 2.5; needs whole numbers"),
        (f"{TERMS}=0,1", "greater than or equal to 1"),
        (f"{TERMS}=lin(1,3,3)", "got a range; whole numbers are listed"),
        (f"{TERMS}={','.join(map(str, range(1, 101)))}", "makes 100 structures, each a program of its own"),
        (f"{PRIOR}=a,b", "got 'a'; needs numbers"),
        (f"{PRIOR}=1,b", "could not convert string to float: 'b'"),
        ("estimator.basis.type=odd,legendre", r"legendre\): estimator.basis.lower: is missing"),
        ("estimator.torqe.type=residual", "leads to no number of the study"),
    ],
)  # fmt: skip
def test_an_axis_that_makes_no_study_is_refused(grid, said):
    with pytest.raises(InputError, match=said):
        with_grid(load_study(SERIAL), [grid], 2)
