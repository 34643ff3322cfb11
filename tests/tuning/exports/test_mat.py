"""What MATLAB and Octave compute with is a double."""

from __future__ import annotations

import io

import numpy as np
import pytest
import scipy.io

from tests.tuning.exports.families import subject
from tuning.exports.formats.mat import plain, write_mat


def numbers(tree, place=""):
    if tree is None:  # a table without entries
        return
    for name in tree.dtype.names or ():
        for entry in tree[name].flat:
            yield from numbers(entry, f"{place}.{name}")
    if tree.dtype == object:
        for entry in tree.flat:
            yield from numbers(entry, place)
    elif not tree.dtype.names:
        yield place, tree


@pytest.mark.contract
def test_every_number_is_a_double_and_every_truth_logical():
    ((_, written),) = write_mat(subject("damping")).files.items()
    contents = scipy.io.loadmat(io.BytesIO(written), mat_dtype=True)
    found = dict(one for name, tree in contents.items() if name[0] != "_" for one in numbers(tree, name))
    assert {values.dtype.kind for values in found.values()} == {"f", "b", "U"}
    for place in ("config.schema_version", "golden.outputs.skipped", "golden.time", "parameters.observer.cutoff"):
        assert found[place].dtype == float, place
    assert found["golden.outputs.held"].dtype == bool


@pytest.mark.contract
def test_a_whole_number_is_exact_or_text():
    assert plain(7) == 7.0
    assert isinstance(plain(7), float)
    assert plain(2**53 + 1) == "9007199254740993"
    assert plain(True) is True
    assert plain(np.arange(3, dtype=np.int32)).dtype == float
    assert plain([1, 2]).dtype == float
