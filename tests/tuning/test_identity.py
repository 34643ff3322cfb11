"""What a shipped file is called by its hash stays, as run folders, exports and tuned files name it.

It changes with the file, and with what the file says by default: then the edition of its kind's answers does, too.
"""

import json
from pathlib import Path

import pytest

from tuning.files.shipped import CONFIGS

GOLDEN = json.loads((Path(__file__).parents[1] / "golden" / "hashes.json").read_text(encoding="utf-8"))


@pytest.mark.structure
def test_every_shipped_file_has_its_hash():
    found = {path.relative_to(CONFIGS).with_suffix("").as_posix() for path in CONFIGS.glob("*/*.toml")}
    assert found == GOLDEN.keys(), "add the hash of a new file, as `vsajax check` prints it"


@pytest.mark.equivalence
@pytest.mark.parametrize("name", GOLDEN)
def test_the_hash_of_a_shipped_file_is_what_it_was(vsajax, name):
    ended = vsajax("check", CONFIGS / f"{name}.toml", "--json")
    assert (ended.code, ended.err) == (0, "")
    assert json.loads(ended.out)["hash"] == GOLDEN[name]
