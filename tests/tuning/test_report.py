"""Reports: every command's run becomes one file that needs no other, and says what the files say."""

from __future__ import annotations

import base64
import json
import re
import shutil
from html.parser import HTMLParser
from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.tuning.builders import FORGETTING, PRIOR, SERIAL, SMALL, TINY, edit_manifest
from tuning.cli.main import run as run_command
from tuning.files.shipped import CONFIGS
from tuning.kinds.estimation.traces import Replay, draw_band, draw_cases
from tuning.pictures import page
from tuning.pictures.style import new_figure
from tuning.report import tables
from tuning.report.compose import report_run
from tuning.report.effort import effort_of, tabulate_effort
from tuning.report.gather import Contestant, open_finished, short_names
from tuning.report.pictures import scores as pictures
from tuning.report.searches import what_is_tuned
from tuning.runs import machine
from tuning.runs.folder import RunStore, open_run, read_results
from tuning.runs.manifest import read_manifest
from tuning.runs.sealed import columns_of
from tuning.scoring.summary import Interval
from tuning.study.base import resolved, to_toml
from tuning.study.loading import load_config, load_study, with_numbers
from tuning.study.statistic import Statistic

SHORT = [word for setting in (*SMALL, *TINY) for word in ("--set", setting)]
DAMPING = CONFIGS / "studies" / "damping.toml"
LAW = "estimator.fit={ prior_scale = 1.0, law = { type = 'forgetting', forgetting = 0.95 } }"
VARIED = (
    "population={vary={'joint.link.inertia'={type='uniform',low=0.9,high=1.1,relative=true},"
    "'sensing.motor_torque.noise_std'={type='uniform',low=1e-3,high=1e-2}},"
    "failures={bad='msrep > 1', late='known_time > 0.1'}}"
)
TUNED = f"tune={{starts=1, screen=4, max_steps=2, parameters={{'{PRIOR}'={{low=1e-3,high=10.0}}, \
'{FORGETTING}'={{low=0.5,high=0.999}}}}}}"
WORDS = {
    "montecarlo": ["--set", VARIED, "--scenarios", "64", "--sensitivity", "8"],
    "sweep": [
        "--set",
        LAW,
        "--scenarios",
        "3",
        "--grid",
        f"{PRIOR}=1e-3,1.0,10",
        "--grid",
        f"{FORGETTING}=0.9,0.99",
    ],
    "tune": ["--set", LAW, "--set", TUNED],
}
COMMANDS = [*WORDS, "compare"]


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """A finished run of every command, and another Monte Carlo run of the same robots."""
    folder = tmp_path_factory.mktemp("runs")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(machine, "start_jax", lambda: None)
        for command, words in WORDS.items():
            assert run_command([command, str(SERIAL), "-o", str(folder / command), "-q", *SHORT, *words]) == 0
        other = ["--set", "estimator.fit.prior_scale=0.01", *WORDS["montecarlo"]]
        assert run_command(["montecarlo", str(SERIAL), "-o", str(folder / "other"), "-q", *SHORT, *other]) == 0
        studies = [str(SERIAL), str(folder / "tune" / "best.toml")]
        compared = ["compare", *studies, "-s", str(SERIAL), "-o", str(folder / "compare"), "-q", *SHORT]
        assert run_command(compared) == 0
    return folder


class Reader(HTMLParser):
    """What a page holds: pictures, words, and tags that are open."""

    def __init__(self, text: str):
        super().__init__()
        self.images: list[dict[str, str]] = []
        self.addresses: list[str] = []
        self.words: list[str] = []
        self.open: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        if tag not in {"meta", "link", "img", "wbr"}:
            self.open.append(tag)
        self.addresses += [value for name, value in attrs if name in {"src", "href"}]
        if tag == "img":
            self.images.append(dict(attrs))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)


def read(path) -> tuple[Reader, str]:
    text = path.read_text(encoding="utf-8")
    reader = Reader(text)
    return reader, " ".join(" ".join(reader.words).split())


def needs_nothing_else(reader: Reader, text: str) -> None:
    """Check that a page is whole: pictures inside, with words for each, no script, nothing from elsewhere."""
    assert reader.open == []
    assert all(address.startswith("data:") for address in reader.addresses)
    assert not re.search(r"<script|@import|url\(", text)
    assert '<meta name="viewport"' in text
    assert reader.images
    for image in reader.images:
        kind, content = re.fullmatch(r"data:image/(svg\+xml|png);base64,(.*)", image["src"]).groups()
        drawn = base64.b64decode(content)
        assert drawn.startswith(b"\x89PNG") if kind == "png" else b"</svg>" in drawn
        assert len(image["alt"]) > 20
        assert "nan" not in image["alt"]


@pytest.mark.cli
@pytest.mark.parametrize("command", COMMANDS)
def test_a_report_is_one_file_that_needs_no_other(command, runs, tmp_path, vsajax):
    path = tmp_path / "report.html"
    ended = vsajax("report", runs / command, "-o", path, "--json")
    assert (ended.code, ended.err) == (0, "")
    said = json.loads(ended.out)
    reader, words = read(path)
    text = path.read_text(encoding="utf-8")
    needs_nothing_else(reader, text)
    assert len(reader.images) == said["pictures"]
    assert path.stat().st_size == said["bytes"] < 5e6
    assert said["headline"] in words
    manifest = json.loads((runs / command / "manifest.json").read_text())
    assert manifest["study_hash"] in words
    assert f"jax {manifest['versions']['jax']}" in words
    assert "[clock]" in words
    # Pictures come first.
    assert text.index("<img") < text.index("<table")


def test_the_same_run_makes_the_same_file(runs, tmp_path, vsajax):
    texts = []
    for name in ("a", "b"):
        assert vsajax("report", runs / "sweep", "-o", tmp_path / name).code == 0
        texts.append((tmp_path / name).read_bytes())
    assert texts[0] == texts[1]


SHOWN = {
    "montecarlo": ["The worst robots", "What moves the score", "Score against each number", "Scores by failure"],
    "sweep": [f"{PRIOR[10:]} and {FORGETTING[14:]}", "The best 2 of 6", "Accuracy against convergence time"],
    "tune": ["True and estimated stiffness, tuned", "Points tried", "The best 2 of 5", "Scores over each other"],
    "compare": ["True and estimated stiffness: serial.toml", "True and estimated stiffness: best.toml"],
}


@pytest.mark.parametrize("command", COMMANDS)
def test_a_report_shows_what_its_command_is_about(command, runs, tmp_path, vsajax):
    path = tmp_path / "report.html"
    assert vsajax("report", runs / command, "-o", path, "-q").out == ""
    _, words = read(path)
    for title in ("True and estimated stiffness", *SHOWN[command]):
        assert title in words


def test_the_numbers_are_those_of_the_files(runs, tmp_path, vsajax):
    written = json.loads((runs / "montecarlo" / "summary.json").read_text())
    path = tmp_path / "report.html"
    vsajax("report", runs / "montecarlo", "-o", path)
    _, words = read(path)
    for quantiles in written["quantiles"].values():
        assert page.number(float(quantiles["0.5"]["value"])) in words
    for total in (influence["total"] for influence in written["influences"].values()):
        assert tables.bracketed(Interval(**total), 100.0) in words
    assert all(f"robot {number}: msrep" in path.read_text() for number in written["worst"])
    sweep = open_finished(runs / "sweep")
    assert page.number(sweep.ranking[0]["mean"]) in vsajax("report", runs / "sweep", "-o", path).out


def test_a_summary_that_is_missing_is_computed_again(runs, tmp_path):
    copied = shutil.copytree(runs / "montecarlo", tmp_path / "run")
    written = open_finished(copied).summary
    (copied / "summary.json").unlink()
    computed = open_finished(copied).summary
    # As text, a number that is missing is the same as another.
    assert str(computed.quantiles) == str(written.quantiles)
    assert computed.failures == written.failures
    assert computed.worst == written.worst
    assert computed.influences.keys() == written.influences.keys()


def test_two_runs_of_the_same_robots_are_paired(runs, tmp_path, vsajax):
    path = tmp_path / "two.html"
    ended = vsajax("report", runs / "montecarlo", runs / "other", "-o", path)
    assert ended.code == 0
    reader, words = read(path)
    needs_nothing_else(reader, path.read_text(encoding="utf-8"))
    a, b = (open_finished(runs / name).best.scores["msrep"] for name in ("montecarlo", "other"))
    assert f"paired difference {page.signed(float(np.mean(b - a)))} %" in words
    assert "estimator. fit. prior_scale" in words
    for title in ("Scores over each other", "Scenario by scenario", "Paired differences", "study of other"):
        assert title in words


@pytest.mark.parametrize("command", ["sweep", "tune", "compare"])
def test_two_searches_are_compared_by_their_best(command, runs, tmp_path, vsajax):
    copied = shutil.copytree(runs / command, tmp_path / "again")
    ended = vsajax("report", runs / command, copied, "-o", tmp_path / "two.html")
    assert ended.code == 0
    assert "paired difference +0 %" in ended.out


def test_runs_of_other_seeds_are_not_paired(runs, tmp_path, vsajax):
    copied = shutil.copytree(runs / "montecarlo", tmp_path / "seed")
    results = read_results(copied)
    edit_manifest(copied, lambda manifest: manifest["study"].update(seed=7))
    reseal_results(copied, results)
    ended = vsajax("report", runs / "montecarlo", copied, "-o", tmp_path / "two.html")
    assert ended.code == 0
    assert "nothing is paired" in ended.out
    assert "Paired differences" not in read(tmp_path / "two.html")[1]


def test_a_name_cannot_break_the_page(runs, tmp_path, vsajax):
    copied = shutil.copytree(runs / "montecarlo", tmp_path / "<b>$x$")
    edit_manifest(copied, lambda manifest: manifest["study"].update(name="<script>alert(1)</script> $\\frac$"))
    for words in ([copied], [copied, runs / "other"]):
        assert vsajax("report", *words, "-o", tmp_path / "report.html").code == 0
        needs_nothing_else(*read_text(tmp_path / "report.html"))


def reseal_results(folder, table) -> None:
    """Write results as if the run had come to them."""
    RunStore(folder, read_manifest(folder / "manifest.json")).write_results(columns_of(table))


def read_text(path) -> tuple[Reader, str]:
    text = path.read_text(encoding="utf-8")
    return Reader(text), text


def remove(name):
    return lambda folder: (folder / name).unlink()


def shorten(folder):
    """Make a run look like one that was stopped before its precision was reached."""
    edit_manifest(folder, lambda manifest: manifest["plan"].update(scenarios=1000))
    (folder / "summary.json").unlink()


@pytest.fixture
def contested(runs, tmp_path):
    """A contest's folder, moved after it ran: two options' configurations, and the comparison that ends it."""
    ran = tmp_path / "ran"
    settings = [word for word in SHORT if word != "--set"]
    plan = {"method": "cmaes", "batch": 4, "trials": 8}
    open_run(ran, "contest", load_study(SERIAL, settings), plan, [], resume=False)
    for options, source in (("rigid", SERIAL), ("memory", runs / "tune" / "best.toml")):
        (ran / options).mkdir()
        shutil.copy(source, ran / options / "best.toml")
    files = [str(ran / options / "best.toml") for options in ("rigid", "memory")]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(machine, "start_jax", lambda: None)
        assert run_command(["compare", *files, "-s", str(SERIAL), "-o", str(ran / "compare"), "-q", *SHORT]) == 0
    return ran.rename(tmp_path / "contest")


def test_a_contest_is_reported_on_with_what_each_was_tuned_to(contested, tmp_path, vsajax):
    path = tmp_path / "report.html"
    ended = vsajax("report", contested, "-o", path)
    assert (ended.code, ended.err) == (0, "")
    reader, words = read(path)
    needs_nothing_else(reader, path.read_text(encoding="utf-8"))
    for said in ("Best of 2", "What each was tuned to", "8 trials of cmaes", "nothing: it has no number to tune"):
        assert said in words
    # Both are replayed from their files in the run's folder.
    assert "True and estimated stiffness: rigid" in words
    assert "True and estimated stiffness: memory" in words
    assert f"Next: vsajax export {contested / 'rigid' / 'best.toml'}" in ended.out
    (contested / "compare" / "results.parquet").unlink()
    assert "holds an unfinished run" in vsajax("report", contested, "-o", path).err


def test_what_tuning_changed_is_told_of_every_table(runs):
    found = open_finished(runs / "tune")
    page = report_run(found)
    (changed,) = [table for table in page.tables if table.title == "What tuning changed"]
    assert {row[0] for row in changed.rows} >= {PRIOR, FORGETTING}
    # A damping study has no estimator: its controller and observer were tuned.
    swing = load_study(DAMPING)
    tuned = with_numbers(swing, {"observer.cutoff": 33.0}, "tuned")
    pair = [Contestant(name, study, {}) for name, study in (("before", swing), ("tuned", tuned))]
    told = tables.tabulate_changes(*map(what_is_tuned, pair), ("before", "tuned"))
    assert [row[0] for row in told.rows] == ["observer.cutoff"]


@pytest.mark.failure
def test_an_export_is_no_run(tmp_path, vsajax):
    (tmp_path / "manifest.json").write_text('{"format": "c99"}')
    (tmp_path / "golden.csv").touch()
    ended = vsajax("report", tmp_path)
    assert ended.code == 2
    assert "holds an export, not a run" in ended.err


def test_tuning_on_a_log_is_reported_on(tmp_path, vsajax):
    part = {"correlation": 0.9, "unlagged": 0.8, "stiffness": 7.5, "rms": 0.2, "samples": 40}
    config = load_config(CONFIGS / "tuned" / "sea_sensor.toml")
    provenance = {
        "command": "tune",
        "objective": "agreement",
        "recording": {"file": "log.csv", "train_until": 3.0},
        "study_hash": "0123",
        "seed": 0,
        "versions": {"jax": "1"},
        "tuned": [PRIOR],
        "train": part,
        "held_out": part,
        "noise_floor": 0.1,
        "held_out_within_floor": 0.99,
    }
    (tmp_path / "best.toml").write_text(to_toml(resolved(config) | {"provenance": provenance}))
    rows = {PRIOR: [0.1, 1.0], "objective": [3.0, 2.0], "stage": ["screen", "refine"], "message": ["", ""]}
    pq.write_table(pa.table(rows), tmp_path / "results.parquet")
    ended = vsajax("report", tmp_path)
    assert (ended.code, ended.err) == (0, "")
    reader, words = read(tmp_path / "report.html")
    needs_nothing_else(reader, (tmp_path / "report.html").read_text(encoding="utf-8"))
    assert "agreement of 2 %" in ended.out
    for said in ("log.csv", "What was tuned", "samples up to 3 s", "held out"):
        assert said in words
    (tmp_path / "best.toml").write_text(to_toml(resolved(config) | {"provenance": {"recording": {}}}))
    assert "is not as tuning on a log has left it" in vsajax("report", tmp_path).err


BROKEN = {
    "no results": ("sweep", remove("results.parquet"), ["holds an unfinished run", "vsajax sweep", "--resume"]),
    "no best": ("tune", remove("best.toml"), ["no best.toml", "--resume"]),
    "stopped": ("montecarlo", shorten, ["some of its scenarios are missing", "--resume"]),
    "no manifest": ("sweep", remove("manifest.json"), ["is no run folder", "sweep, tune, compare or contest"]),
    "bad manifest": ("sweep", lambda f: (f / "manifest.json").write_text("{"), ["cannot be read as a manifest"]),
    "list": ("sweep", lambda f: (f / "manifest.json").write_text("[]"), ["cannot be read as a manifest"]),
    "lacking": ("sweep", lambda f: (f / "manifest.json").write_text("{}"), ["it lacks command, study_hash, plan"]),
    "other command": (
        "sweep",
        lambda f: edit_manifest(f, lambda manifest: manifest.update(command="x")),
        ["holds a run of 'x'"],
    ),
    "bad results": ("sweep", lambda f: (f / "results.parquet").write_text("x"), ["cannot be read", "--resume"]),
    "bad summary": ("montecarlo", lambda f: (f / "summary.json").write_text("{}"), ["summary.json", "--resume"]),
}


@pytest.mark.failure
@pytest.mark.parametrize("case", BROKEN)
def test_what_is_no_finished_run_is_refused(case, runs, tmp_path, vsajax):
    command, spoil, said = BROKEN[case]
    copied = shutil.copytree(runs / command, tmp_path / "run")
    spoil(copied)
    ended = vsajax("report", copied, "-o", tmp_path / "report.html")
    assert (ended.code, ended.out) == (2, "")
    for words in said:
        assert words in ended.err
    assert not (tmp_path / "report.html").exists()


@pytest.mark.failure
def test_what_cannot_be_reported_on_is_refused(runs, tmp_path, vsajax):
    path = tmp_path / "report.html"
    refused = [
        ([runs / "none"], "no such folder"),
        ([SERIAL], "is no folder"),
        ([runs / "montecarlo" / "design"], "holds the design of a run"),
        ([runs / "sweep", runs / "tune"], "report on two runs of one command"),
        ([runs / "sweep", runs / "sweep"], "is named twice"),
    ]
    for words, said in refused:
        ended = vsajax("report", *words, "-o", path)
        assert (ended.code, ended.out) == (2, "")
        assert said in ended.err
    assert not path.exists()
    assert "is a folder" in vsajax("report", runs / "sweep", "-o", tmp_path).err


def test_the_front_is_what_nothing_beats():
    rng = np.random.default_rng(0)
    accuracy, time = rng.random((2, 60))
    accuracy[3], time[4] = np.nan, np.inf
    found = set(pictures.front(accuracy, time).tolist())
    usable = [i for i in range(60) if i not in {3, 4}]
    expected = {
        i for i in usable if not any(accuracy[j] <= accuracy[i] and time[j] <= time[i] for j in usable if j != i)
    }
    assert found == expected
    assert not pictures.front(np.array([np.nan]), np.array([1.0])).size


@pytest.mark.statistical
def test_the_effort_of_a_search_counts_steps_and_time_until_a_score_is_reached():
    def search(**columns: list[float]) -> SimpleNamespace:
        return SimpleNamespace(columns={name: np.array(values) for name, values in columns.items()})

    gradient = search(objective=[9.0, np.nan, 5.0, 2.0], steps=[0, 0, 0, 7], seconds=[1.0, 1.0, 1.0, 4.0])
    trials = search(objective=[8.0, 1.0, 3.0], seconds=[0.5, 0.5, 0.5])
    effort = effort_of(gradient)
    np.testing.assert_array_equal(effort.evaluations, [1, 2, 3, 10])
    np.testing.assert_array_equal(effort.best, [9.0, 9.0, 5.0, 2.0])
    assert effort.reach(5.0) == (3, 3.0)
    assert effort.reach(1.9) is None
    # Both reach 2 % and one in a hundred more.
    first, second = tabulate_effort({"gradient": gradient, "trials": trials}).rows
    assert first == ["gradient", 2.0, 10, 7.0, 10, 7.0]
    assert second == ["trials", 1.0, 3, 1.5, 2, 1.0]


@pytest.mark.parametrize(
    "statistic",
    [
        one if one.level == 0.5 and one.kind == "quantile" else pytest.param(one, marks=pytest.mark.slow)
        for one in tables.STATISTICS
    ],
    ids=lambda s: s.label,
)
def test_intervals_of_many_scenarios_are_those_of_the_bootstrap(statistic, monkeypatch):
    rng = np.random.default_rng(1)
    first = rng.lognormal(size=8000)
    second = 0.8 * first + 0.1 * rng.lognormal(size=8000)
    found = {}
    for name, limit in (("bootstrap", 8192), ("blocks", 0)):
        monkeypatch.setattr(tables, "_BOOTSTRAP", limit)
        found[name] = tables.paired(first, second, statistic, seed=0)
    assert found["blocks"].value == found["bootstrap"].value
    widths = {name: each.high - each.low for name, each in found.items()}
    # The standard deviation of a spread over 32 blocks is 13 % of it: three of them, and the quantiles' own.
    assert 0.55 < widths["blocks"] / widths["bootstrap"] < 1.6


def test_a_statistic_with_infinite_values_has_no_interval():
    found = tables.estimated(np.array([1.0, 2.0, np.inf]), Statistic(kind="quantile", level=0.5), seed=0)
    assert found.value == 2.0
    assert np.isnan([found.low, found.high]).all()


def test_paths_and_folders_are_as_short_as_they_can_be_told_apart():
    encoder = "encoder.counts_per_revolution"
    assert pictures.short_paths([f"sensing.a.{encoder}", f"sensing.b.{encoder}", "joint.link.inertia", "x"]) == [
        f"a.{encoder}",
        f"b.{encoder}",
        "link.inertia",
        "x",
    ]
    assert short_names(["runs/a", "runs/b"]) == ["a", "b"]
    assert short_names(["x/a", "y/a"]) == ["x/a", "y/a"]


def test_numbers_read_well():
    assert [page.number(x) for x in (1.23456, -1e-9, np.nan, np.inf)] == ["1.235", "−1e−09", "–", "∞"]
    assert [page.signed(x) for x in (0.5, -0.5, np.nan)] == ["+0.5", "−0.5", "–"]


def diverged(folder):
    """Make a run look like one whose every scenario diverged."""
    path = folder / "results.parquet"
    table = pq.read_table(path)
    for name in ("msrep", "msrep_settled", "mse", "mse_settled", "max_relative_error", "coverage"):
        place = table.column_names.index(name)
        table = table.set_column(place, name, pa.array(np.full(table.num_rows, np.nan)))
    if "status" in table.column_names:
        place = table.column_names.index("status")
        table = table.set_column(place, "status", pa.array(np.full(table.num_rows, 3)))
        (folder / "summary.json").unlink()
        shutil.rmtree(folder / "design")
    reseal_results(folder, table)


@pytest.mark.parametrize(
    "command", ["sweep", *(pytest.param(c, marks=pytest.mark.slow) for c in ("montecarlo", "compare"))]
)
def test_a_run_without_any_score_is_reported_on_all_the_same(command, runs, tmp_path, vsajax):
    copied = shutil.copytree(runs / command, tmp_path / "run")
    diverged(copied)
    for words in ([copied], [copied, runs / command], [runs / command, copied]):
        ended = vsajax("report", *words, "-o", tmp_path / "report.html")
        assert ended.code == 0
        needs_nothing_else(*read_text(tmp_path / "report.html"))
    if command != "montecarlo":
        assert "no finite msrep" in ended.out


@pytest.mark.parametrize("value", [np.nan, np.inf, 0.0])
def test_traces_that_are_not_finite_or_never_move_are_drawn(value, tmp_path):
    nothing = np.full((3, 20), value)
    for known in (np.zeros((3, 20), bool), np.ones((3, 20), bool)):
        traces = Replay(np.tile(np.linspace(0, 1, 20), (3, 1)), nothing, nothing, known)
        for figure in (draw_band(traces), draw_cases(traces, ["a", "b", "c"])):
            assert page.Picture("", figure, "", "").address.startswith("data:image/svg+xml;base64,")


def test_a_drawing_of_many_lines_is_sent_as_pixels():
    rng = np.random.default_rng(0)
    figure, axis = new_figure(5.0, 4.0)
    for _ in range(400):
        axis.plot(rng.random(60))
    assert page.Picture("", figure, "", "").address.startswith("data:image/png;base64,")
