"""The flags that the lab hands to XLA."""

from __future__ import annotations

from tuning.runs.machine import usable_cores, with_lab_flags


def test_flags_that_are_not_given_are_added():
    flags = with_lab_flags("--xla_dump_to=folder").split()
    assert flags[0] == "--xla_dump_to=folder"
    assert f"--xla_force_host_platform_device_count={usable_cores()}" in flags
    assert len(flags) == 4


def test_a_flag_of_the_users_own_is_kept():
    flags = with_lab_flags("--xla_cpu_prefer_vector_width=256").split()
    assert [flag for flag in flags if "vector_width" in flag] == ["--xla_cpu_prefer_vector_width=256"]
    assert with_lab_flags(" ".join(flags)) == " ".join(flags)
