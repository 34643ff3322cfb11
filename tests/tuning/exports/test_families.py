"""Every format of every family is written and holds: the fast twin of the long recordings in `test_formats`."""

from __future__ import annotations

import json

import pytest

from tests.tuning.exports.families import FAMILIES, TARGETS, subject
from tests.tuning.exports.native import needs_compiler
from tuning.exports.export import write_export
from tuning.exports.readme import told_of_single_precision
from tuning.exports.recheck import check_folder


@needs_compiler
@pytest.mark.equivalence
@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("target", TARGETS)
def test_every_format_of_every_family_holds(family, target, tmp_path, monkeypatch, request):
    # The checks run in processes of their own, on the packages of this checkout.
    monkeypatch.setenv("PYTHONPATH", str(request.config.rootpath))
    whole = target in {"fmi2", "fmi3", "mat", "ros2"}
    done = write_export(subject(family), target, FAMILIES[family][0], tmp_path, thorough=whole)
    assert done.ok, done.results
    lacking = {one["what"] for one in done.results if one["state"] == "skipped"}
    assert all("not installed" in what for what in lacking), lacking
    manifest = json.loads((tmp_path / "manifest.json").read_text())
    for name in (*manifest["files"], *manifest["shipped"]):
        assert (tmp_path / name).stat().st_size, name
    if target == "ros2":
        assert check_folder(tmp_path).ok


@needs_compiler
@pytest.mark.equivalence
def test_single_precision_is_stated_for_the_worst_of_all_outputs(tmp_path, monkeypatch, request):
    monkeypatch.setenv("PYTHONPATH", str(request.config.rootpath))
    done = write_export(subject("fit"), "c99", FAMILIES["fit"][0], tmp_path)
    (single,) = [one for one in done.results if one["name"] == "single precision"]
    figures = single["figures"]
    reals = {key: off for key, off in figures["deviation"].items() if key not in figures["differing"]}
    worst = max(reals, key=lambda key: reals[key])
    assert f"of all outputs {worst} is off the most, by {reals[worst]:.2g}" in single["what"]
    page = (tmp_path / "README.md").read_text()
    assert all(f"| `{key}` | {off:.2g} |" in page for key, off in reals.items() if off)


def test_what_is_not_finite_in_single_precision_is_said_plainly():
    figures = {
        "deviation": {"a": 0.5, "b": 0.0, "known": 1.0},
        "final_deviation": {"a": 0.25, "b": None, "known": 0.0},
    }
    figures |= {"not_finite": {"b": 7}, "differing": {"known": 3}}
    found = told_of_single_precision({"what": "stated, not judged: as it is", "figures": figures})
    assert found is not None
    assert found["told"] == "as it is"
    assert [(row["name"], row["worst"], row["final"], row["lost"]) for row in found["rows"]] == [
        ("a", "0.5", "0.25", 0),
        ("b", "0", "not finite", 7),
    ]
    assert told_of_single_precision({"what": "", "figures": {"deviation": {}}}) is None
