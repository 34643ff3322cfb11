"""The page on a log, and --strict: what is said where, in one self-contained file."""

from __future__ import annotations

import re

import numpy as np
import pytest

from tests.tuning.logs.robot_logs import spring_log, with_gap, write_spring_log
from tuning.files.shipped import CONFIGS

CONFIG = CONFIGS / "tuned" / "sea_sensor.toml"


@pytest.mark.cli
def test_a_faulty_log_gets_a_page_that_names_the_faults_and_with_strict_an_exit_code(vsajax, tmp_path):
    columns = with_gap(spring_log(), 150, 0.3)
    log = write_spring_log(tmp_path, columns | {"deflection": np.rad2deg(columns["deflection"])})
    words = ("estimate", log, "--map", tmp_path / "map.toml", "-c", CONFIG, "-o", tmp_path / "out.parquet")
    page = tmp_path / "log.html"
    ended = vsajax(*words, "--report", page, "--strict")
    assert (ended.code, ended.err) == (1, "")
    assert "WARNING: degrees for radians: deflection" in ended.out
    assert "largest gap 300 ms" in ended.out
    text = page.read_text()
    for said in (
        "Something is wrong with the log: degrees for radians",
        "Torque over deflection",
        "The longest gaps",
    ):
        assert said in text
    # One file: every picture is inside it, nothing is fetched.
    addresses = re.findall(r'(?:src|href)="([^"]*)"', text)
    assert len([a for a in addresses if a.startswith("data:image")]) == 4
    assert all(a.startswith("data:") for a in addresses)
    assert "<script" not in text

    good = write_spring_log(tmp_path, spring_log())
    assert good == log
    assert vsajax(*words, "--strict").code == 0
