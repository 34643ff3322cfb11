"""Names of the lab that a document once showed are found where they were, and warn."""

import importlib
import subprocess
import sys

import pytest

SHOWN = {
    ("tuning.runtime", "start_jax"): "tuning.runs.machine",
    ("tuning.build", "build_estimator"): "tuning.problem.build",
    ("tuning.problem", "draw_scenarios"): "tuning.problem.scenarios",
    ("tuning.study", "load_study"): "tuning.study.loading",
    ("tuning.study", "study_hash"): "tuning.study.base",
}


@pytest.mark.parametrize("old", sorted(SHOWN))
def test_a_name_is_found_where_it_was(old):
    module, name = importlib.import_module(old[0]), old[1]
    with pytest.warns(DeprecationWarning, match=f"{old[0]}.{name} is now {SHOWN[old]}.{name}"):
        assert getattr(module, name) is getattr(importlib.import_module(SHOWN[old]), name)


def test_the_problem_of_an_estimator_is_found_under_its_old_name():
    from tuning.kinds.estimation.problem import EstimationProblem

    with pytest.warns(DeprecationWarning, match="tuning.problem.Problem is now tuning.kinds.estimation.problem"):
        assert importlib.import_module("tuning.problem").Problem is EstimationProblem


def test_a_study_still_does_not_wait_for_jax():
    code = "import sys, tuning.study; from tuning.study import loading; sys.exit('jax' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)
