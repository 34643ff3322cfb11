"""Writing and checking studies; nothing here imports jax."""

from __future__ import annotations

from pathlib import Path

import click

from tuning.cli.options import JSON, QUIET, SETTINGS, STUDY, emit


@click.command(epilog="Example: vsajax init serial study.toml")
@click.argument("kind")
@click.argument("file", type=click.Path(path_type=Path), required=False)
@JSON
@QUIET
def init(kind: str, file: Path | None, as_json: bool, quiet: bool) -> None:
    """Write a commented study of KIND (serial, sea, arm, …) that runs as it is, to FILE or KIND.toml."""
    from tuning.errors import input_error
    from tuning.resources import example_path
    from tuning.store import write_text

    target = file or Path(f"{kind}.toml")
    example = example_path(kind, "KIND")
    if target.exists():
        raise input_error(target, "exists already", "name another file, or remove it first")
    write_text(target, example.read_text(encoding="utf-8"))
    emit({"study": target}, as_json=as_json, quiet=quiet, text=f"wrote {target}; try: vsajax check {target}")


@click.command(epilog="Example: vsajax check study.toml --set estimator.fit.prior_scale=0.1")
@STUDY
@SETTINGS
@JSON
@QUIET
def check(study: Path, settings: tuple[str, ...], as_json: bool, quiet: bool) -> None:
    """Validate STUDY and print it in full, every default written out, with its hash."""
    from tuning.arm.study import is_arm_study, load_arm_study
    from tuning.schema import read_toml
    from tuning.study import Study, load_config, resolved, study_hash, to_toml

    is_arm = is_arm_study(read_toml(study))
    config = load_arm_study(study, settings) if is_arm else load_config(study, settings)
    kind = "study" if is_arm or isinstance(config, Study) else "estimator configuration"
    tables, digest = resolved(config), study_hash(config)
    emit(
        {"ok": True, "what": kind, "hash": digest, "study": tables},
        as_json=as_json,
        quiet=quiet,
        text=lambda: f"{to_toml(tables)}\n# {study}: valid {kind}, hash {digest}",
    )
