"""A study as data: the TOML file and its tables. Nothing here imports jax."""

from typing import Any

_MOVED: dict[str, str] = {
    **dict.fromkeys(("Config", "Study", "resolved", "study_hash", "to_toml"), "tuning.study.base"),
    **dict.fromkeys(("load_config", "load_study", "parse_study", "with_numbers"), "tuning.study.loading"),
}
"""What was in a module of this name; it is found here for one release."""


def __getattr__(name: str) -> Any:
    if name not in _MOVED:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    # Only who still asks for it waits for the library, and so for jax.
    from vsajax.moved import old_names

    return old_names(__name__, _MOVED)(name)
