"""Writing and checking studies; nothing here imports jax."""

from __future__ import annotations

from pathlib import Path

import click

from tuning.cli.options import JSON, QUIET, SETTINGS, STUDY, emit


@click.command(epilog="Example: vsajax init serial study.toml")
@click.argument("kind")
@click.argument("file", type=click.Path(path_type=Path), required=False)
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Of init map; by default LOG's name, .toml.")
@JSON
@QUIET
def init(kind: str, file: Path | None, output: Path | None, as_json: bool, quiet: bool) -> None:
    """Write a commented study of KIND (serial, sea, damping, arm, …) that runs as it is, to FILE or KIND.toml.

    `vsajax init map LOG` proposes a signal map of LOG instead, from names and numbers, and explains each guess.
    """
    if kind == "map":
        _init_map(file, output, as_json=as_json, quiet=quiet)
        return
    from tuning.errors import input_error
    from tuning.resources import example_path
    from tuning.store import write_text

    target = file or Path(f"{kind}.toml")
    example = example_path(kind, "KIND")
    if target.exists():
        raise input_error(target, "exists already", "name another file, or remove it first")
    write_text(target, example.read_text(encoding="utf-8"))
    emit({"study": target}, as_json=as_json, quiet=quiet, text=f"wrote {target}; try: vsajax check {target}")


def _init_map(log: Path | None, output: Path | None, *, as_json: bool, quiet: bool) -> None:
    from dataclasses import asdict

    from tuning.errors import input_error
    from tuning.logs.guess import propose, to_map
    from tuning.store import write_text

    if log is None:
        raise input_error("init map", "no log named", "vsajax init map LOG")
    target = output or Path(f"{log.stem}.toml")
    if target.exists():
        raise input_error(target, "exists already", "name another file with -o, or remove it first")
    proposal = propose(log)
    write_text(target, to_map(proposal, log))
    said = [f"clock            {proposal.clock[0]}: {proposal.clock[2]}"]
    said += [f"select           {proposal.select[2]}"] if proposal.select else []
    said += [f"{guess.name:<16} {guess.column}: {'; '.join(guess.reasons)}" for guess in proposal.guesses]
    said += [f"MISSING          {need}, which kind {proposal.kind!r} needs" for need in proposal.lacking]
    said.append(f"wrote {target}: guesses all, check them; then vsajax estimate {log} --map {target} -c CONFIG")
    emit({"map": target, **asdict(proposal)}, as_json=as_json, quiet=quiet, text="\n".join(said))


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
