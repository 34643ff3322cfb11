"""Every format of every family is written and holds: the fast twin of the long recordings in `test_formats`."""

from __future__ import annotations

import json

import pytest

from tests.tuning.exports.families import FAMILIES, TARGETS, subject
from tests.tuning.exports.native import needs_compiler
from tuning.exports.export import write_export
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
