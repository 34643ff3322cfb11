"""Double precision, two host devices, compiled programs shared, type checks of `vsajax`, reference signals."""

from __future__ import annotations

import os
from pathlib import Path

# XLA reads its flags when the first device is asked for; set them before anything imports jax.
os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count=2".strip()

import jax
import jaxtyping
import numpy as np
import pytest

from tuning.runs.machine import with_lab_flags

jax.config.update("jax_enable_x64", True)

TESTS = Path(__file__).parent

Signals = dict[str, np.ndarray]


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add what run-time type checks may be left out by."""
    words = "no run-time type checks of vsajax, and the lab's compiler flags, as its users run it"
    parser.addoption("--unchecked", action="store_true", help=words)


def pytest_configure(config: pytest.Config) -> None:
    """Check types at run time, from before anything imports `vsajax`, or compile as the lab does."""
    if config.getoption("--unchecked"):
        os.environ["XLA_FLAGS"] = with_lab_flags(os.environ["XLA_FLAGS"])
    else:
        jaxtyping.install_import_hook("vsajax", "beartype.beartype")


@pytest.fixture(scope="session", autouse=True)
def _compiled(tmp_path_factory):
    """Keep compiled programs in one folder for every worker and subprocess of this run, out of the user's home.

    Many tests ask for the same small programs, and jax forgets a jitted function with the object that held it.
    """
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "compiled"
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("VSAJAX_CACHE", str(folder))
        yield


@pytest.fixture(scope="session")
def shared() -> Path:
    """The `shared` folder of reference material beside the repository; most checkouts do not have it."""
    folder = TESTS.parents[1] / "shared"
    if not (folder / "reference" / "serial.npz").is_file():
        pytest.skip(f"needs the reference material in {folder}, which this machine does not have")
    return folder


@pytest.fixture(scope="session")
def golden() -> Signals:
    """The first 2001 samples (1 kHz) of the serial reference: SciPy Radau at rtol 1e-9, NumPy estimators."""
    return _signals(TESTS / "golden" / "serial.npz")


@pytest.fixture(params=["golden", pytest.param("shared", marks=pytest.mark.slow)], scope="session")
def reference(request: pytest.FixtureRequest) -> Signals:
    """The serial reference: its golden extract, and all 10,001 samples where `shared` is there."""
    if request.param == "golden":
        return request.getfixturevalue("golden")
    return _signals(request.getfixturevalue("shared") / "reference" / "serial.npz")


@pytest.fixture(params=["golden", pytest.param("shared", marks=pytest.mark.slow)], scope="session")
def swings(request: pytest.FixtureRequest) -> Signals:
    """The damping reference, event-accurate in NumPy and SciPy: thinned, and all of it where `shared` is there."""
    if request.param == "golden":
        return _signals(TESTS / "golden" / "damping.npz")
    return _signals(request.getfixturevalue("shared") / "reference" / "damping.npz")


def _signals(path: Path) -> Signals:
    with np.load(path) as archive:
        return {name: archive[name] for name in archive.files}
