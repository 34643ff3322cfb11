"""Writing and checking studies; nothing here imports jax."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from tuning.cli.following import after_check
from tuning.terminal.following import start, words
from tuning.terminal.options import JSON, QUIET, SETTINGS, STUDY, emit

if TYPE_CHECKING:
    from tuning.files.kinds import FileKind
    from tuning.files.toml import Table
    from tuning.study.limits import Need


@click.command(epilog="Example: vsajax init serial study.toml")
@click.argument("kind", required=False)
@click.argument("file", type=click.Path(path_type=Path), required=False)
@click.option("--list", "lists", is_flag=True, help="Print every file that ships with vsajax and what it is.")
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), help="File; of init map by default LOG's name, .toml."
)
@JSON
@QUIET
def init(
    kind: str | None, file: Path | None, lists: bool, output: Path | None, as_json: bool, quiet: bool
) -> None:
    """Write a commented study of KIND (serial, sea, damping, arm, …) that runs as it is, to FILE or KIND.toml.

    KIND may be the name of any shipped file, as `vsajax init --list` prints them. `vsajax init map LOG` proposes a
    signal map of LOG instead, from names and numbers, and explains each guess.
    """
    if lists:
        _list_shipped(as_json=as_json, quiet=quiet)
        return
    if kind is None:
        raise click.MissingParameter(param_hint="'KIND'", param_type="argument")
    if kind == "map":
        _init_map(file, output, as_json=as_json, quiet=quiet)
        return
    import tomllib

    from tuning.files.errors import input_error
    from tuning.files.shipped import find_shipped
    from tuning.files.whole import write_text
    from tuning.study.schemas import name_in, schema_file, schema_of

    example = find_shipped(kind, f"KIND: got {kind!r}")
    if file is not None and output is not None:
        raise click.UsageError("name the file once: as FILE, or by -o")
    target = file or output or Path(example.name)
    if target.exists():
        raise input_error(target, "exists already", "name another file, or remove it first")
    text = example.read_text(encoding="utf-8")
    name = name_in(tomllib.loads(text))
    schema = None if name is None else target.parent / schema_file(name)
    write_text(target, text if schema is None else f"#:schema {schema.name}\n{text}")
    said = f"wrote {target}"
    if schema is not None and name is not None:
        write_text(schema, json.dumps(schema_of(name), indent=2, ensure_ascii=False) + "\n")
        said += f", and {schema}, by which editors complete and check it"
    following = words("check", target)
    emit({"study": target, "schema": schema}, as_json=as_json, quiet=quiet, text=said, following=following)


def _list_shipped(*, as_json: bool, quiet: bool) -> None:
    from textwrap import shorten

    from tuning.files.shipped import SHIPPED, shipped_files, summary_of

    said = {name: summary_of(path) for name, path in shipped_files().items()}
    width = max(map(len, said))
    lines = [f"{name:<{width}}  {shorten(summary, 110, placeholder=' …')}" for name, summary in said.items()]
    lines += ["", f"Copy one: vsajax init NAME FILE. Or use it where it lies: {SHIPPED}NAME in place of any path."]
    emit({"shipped": said}, as_json=as_json, quiet=quiet, text="\n".join(lines), following=start)


def _init_map(log: Path | None, output: Path | None, *, as_json: bool, quiet: bool) -> None:
    from dataclasses import asdict

    from tuning.files.errors import input_error, printable
    from tuning.files.whole import write_text
    from tuning.logs.guess import propose, to_map

    if log is None:
        raise input_error("init map", "no log named", "vsajax init map LOG")
    target = output or Path(f"{log.stem}.toml")
    if target.exists():
        raise input_error(target, "exists already", "name another file with -o, or remove it first")
    proposal = propose(log)
    write_text(target, to_map(proposal, log))
    said = [f"note: {printable(note)}" for note in proposal.notes]
    said += [f"clock            {printable(proposal.clock[0])}: {printable(proposal.clock[2])}"]
    said += [f"select           {printable(proposal.select[2])}"] if proposal.select else []
    said += [
        f"{guess.name:<16} {printable(guess.column)}: {printable('; '.join(guess.reasons))}"
        for guess in proposal.guesses
    ]
    said += [f"MISSING          {need}, which kind {proposal.kind!r} needs" for need in proposal.lacking]
    said.append(f"wrote {target}: guesses all, check them; then vsajax estimate {log} --map {target} -c CONFIG")
    emit(
        {"map": target, **asdict(proposal)},
        as_json=as_json,
        quiet=quiet,
        text="\n".join(said),
        following=words("check", target),
    )


@click.command(epilog="Example: vsajax check study.toml --set estimator.fit.prior_scale=0.1")
@STUDY
@SETTINGS
@JSON
@QUIET
def check(study: Path, settings: tuple[str, ...], as_json: bool, quiet: bool) -> None:
    """Validate STUDY and print it in full, every default written out, with its hash.

    Configurations, studies of logs and of arms, signal maps and presets are checked alike.
    """
    from tuning.study.base import Base, resolved, study_hash, to_toml
    from tuning.study.limits import require

    kind, config = _load(study, settings)
    require(*_needs_of(config, str(study)))
    what, tables, digest = kind.label, resolved(config), study_hash(config)
    notes = config.notes() if isinstance(config, Base) else []
    emit(
        {"ok": True, "what": what, "hash": digest, "notes": notes, "study": tables},
        as_json=as_json,
        quiet=quiet,
        text=lambda: "\n".join(
            [to_toml(tables), *(f"# note: {note}" for note in notes), f"# {study}: valid {what}, hash {digest}"]
        ),
        following=lambda: after_check(kind.name, _kind_of_joint(config), study, settings),
        comment=True,
    )


def _needs_of(config: Table, place: str) -> list[Need]:
    """Return what a file asks for by itself, whichever command it is given to."""
    from tuning.scoring import needs
    from tuning.study.base import Config, Study

    if isinstance(config, Study):
        return needs.of_study(config, place)
    return [needs.of_fit(config.estimator, place)] if isinstance(config, Config) else []


def _kind_of_joint(config: Table) -> str:
    """Return the kind of the example that a map, a preset or a configuration belongs to."""
    fields = set(type(config).model_fields)
    preset = "antagonistic" if "motor1" in fields else "serial" if "setpoint_motor" in fields else "sea"
    return getattr(config, "kind", preset)


def _load(path: Path, settings: tuple[str, ...]) -> tuple[FileKind, Table]:
    """Return a TOML file of any kind, and which kind that is; what none recognises is read as a configuration."""
    from tuning.files import kinds
    from tuning.files.tables import with_settings
    from tuning.files.toml import read_toml

    tables = with_settings(read_toml(path), settings)
    kind = kinds.kind_of(tables)
    if kind is kinds.SIGNAL_MAP:
        from tuning.logs.signal_map import read_signal_map

        return kinds.SIGNAL_MAP, read_signal_map(path, settings)
    if kind is kinds.JOINT:
        from tuning.study.parts.joints import parse_joint

        return kinds.JOINT, parse_joint(tables, str(path))
    if kind is kinds.ARM:
        from tuning.kinds.arm.kinematics import parse_arm

        return kinds.ARM, parse_arm(tables, str(path))
    from tuning.kinds.estimation.study import EstimationStudy
    from tuning.study.base import Study
    from tuning.study.kinds import kind_of
    from tuning.study.loading import load_config
    from tuning.study.parts.rig import RecordedTorque

    config = load_config(path, settings)
    if isinstance(config, EstimationStudy):
        for _, torque in config.excitation:
            if isinstance(torque, RecordedTorque):
                torque.arguments()
    return kind_of(config).file if isinstance(config, Study) else kinds.CONFIG, config
