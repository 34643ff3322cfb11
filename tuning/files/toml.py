"""Reading TOML files into strict pydantic models, with every mistake reported at its path."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Protocol, get_origin, runtime_checkable

import pydantic
from pydantic_core import PydanticCustomError

from tuning.files.errors import InputError, Mistake, input_error
from tuning.files.shipped import located
from tuning.files.tables import parse_toml

Seed = Annotated[int, pydantic.Field(ge=0, le=2**63 - 1)]
"""Of which random numbers are drawn; what jax can hold."""


def _no_switch(value: Any) -> Any:
    if isinstance(value, bool):
        raise ValueError(f"needs a number; got {str(value).lower()}")
    return value


NO_SWITCH = pydantic.BeforeValidator(_no_switch)
"""What is one of some whole numbers is not `true`, though that equals 1."""
SchemaVersion = Annotated[Literal[1], NO_SWITCH]
"""Of every file."""
REFUSED = "refused"
"""The type of an error that knows its way out; its context is what `refusal` takes."""
UNKNOWN_KEY = "unknown key"
"""What is said of a key that a table does not have."""
_LOGS = {".csv", ".tsv", ".txt", ".dat", ".asc", ".parquet", ".mat", ".h5", ".hdf5", ".bag", ".mcap", ".db3"}
"""What recordings are called; `logs.formats` reads them."""


@runtime_checkable
class NamesTables(Protocol):
    """Metadata of an annotation in place of a closed union."""

    @property
    def tables(self) -> Mapping[str, type[pydantic.BaseModel]]:
        """The tables that may stand there, by the value of their key `type`."""
        ...


class Table(pydantic.BaseModel):
    """A TOML table: unknown keys and non-finite numbers are mistakes; values are never changed later."""

    model_config = pydantic.ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


def read_text(path: Path) -> str:
    """Return the text of a user's file, or of a shipped one (`shipped:NAME`).

    Raises:
        InputError: the file is missing, a directory, unreadable, empty or not UTF-8.
    """
    source = located(path)
    if source.is_dir():
        best = "best.toml" if (source / "best.toml").is_file() else None
        raise input_error(path, "is a directory", f"did you mean {path / best}?" if best else "name a file in it")
    try:
        # Some editors put a mark of the encoding in front.
        text = source.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        near = difflib.get_close_matches(path.name, [p.name for p in path.parent.glob("*")], 1)
        hint = f"did you mean {path.parent / near[0]}?" if near else "check the path"
        raise input_error(path, "no such file", hint) from None
    except UnicodeDecodeError as error:
        raise input_error(
            path, f"is not UTF-8 text (byte {error.start})", _way_out(path, "save it as UTF-8")
        ) from None
    except OSError as error:
        raise input_error(path, f"cannot be read ({error.strerror})", "check its permissions") from None
    if not text.strip():
        raise input_error(path, "is empty", "start from `vsajax init KIND FILE`")
    return text


def read_toml(path: Path) -> dict[str, Any]:
    """Return the tables of a TOML file.

    Raises:
        InputError: as `read_text`, or `tables.parse_toml`.
    """
    return parse_toml(read_text(path), path, _way_out(path, "mend that line"))


def _way_out(path: Path, otherwise: str) -> str:
    """Return what a file that is no TOML is for, as far as its name says."""
    suffix = path.suffix.lower()
    if suffix in _LOGS:
        return f"a log goes to vsajax estimate {path} -c CONFIG"
    if suffix in {".urdf", ".xacro"}:
        return f'a robot description belongs in a study of an arm: urdf = "{path}" in [arm] (vsajax init arm)'
    return otherwise


def validate[Model: pydantic.BaseModel](model: type[Model], data: dict[str, Any], place: str) -> Model:
    """Return `data` as a `model`, or raise one `InputError` that lists every mistake with its path."""
    try:
        return model.model_validate(data)
    except pydantic.ValidationError as error:
        raise InputError(*(_as_mistake(item, model, place) for item in error.errors())) from None


def refusal(key: str, problem: str, fix: str) -> PydanticCustomError:
    """Return the error of a table that is refused by one of its keys, for a validator to raise."""
    return PydanticCustomError(REFUSED, "{problem}", {"key": key, "problem": problem, "fix": fix})


def _as_mistake(item: Any, model: type[pydantic.BaseModel], place: str) -> Mistake:
    keys = [str(key) for key in item["loc"]]
    path = ".".join(_without_tags(keys, model))
    where = f"{place}: {path}" if path else place
    got = item.get("input")
    if item["type"] == "extra_forbidden":
        siblings = _sibling_keys(keys[:-1], model)
        near = difflib.get_close_matches(keys[-1], siblings, 1)
        fix = f"did you mean {near[0]}?" if near else f"remove it; allowed here: {', '.join(siblings)}"
        return Mistake(where, UNKNOWN_KEY, fix)
    if item["type"] == "missing":
        return Mistake(where, "is missing", "add it; the examples that ship with vsajax have every key")
    if item["type"] in {"model_type", "dict_type", "model_attributes_type"}:
        return Mistake(where, f"got {got!r}; needs a table", f"write [{path}] and its keys below it")
    if item["type"] == REFUSED:
        told = item["ctx"]
        return Mistake(f"{where}{'.' if path else ': '}{told['key']}", told["problem"], told["fix"])
    if item["type"] == "union_tag_invalid":
        tag, allowed = item["ctx"]["tag"], item["ctx"]["expected_tags"]
        return Mistake(f"{where}.type", f"got {tag!r}; allowed: {allowed}")
    if item["type"] == "union_tag_not_found":
        return Mistake(f"{where}.type", "is missing", "add it; it says which kind of table this is")
    message = item["msg"].removeprefix("Value error, ")
    shown = "" if isinstance(got, dict | list) or item["type"] == "value_error" else f"got {got!r}; "
    return Mistake(where, shown + message[0].lower() + message[1:])


def _fields_at(keys: list[str], model: type[pydantic.BaseModel]) -> tuple[list[str], list[str]]:
    """Walk `keys` through nested models: (the keys without union tags, the field names at the end)."""
    models, clean = [model], []
    for key in keys:
        tagged = [m for m in models if key in _tags_of(m)] if len(models) > 1 else []
        if tagged:
            models = tagged
            continue
        clean.append(key)
        fields = [m.model_fields[key] for m in models if key in m.model_fields]
        models = [n for field in fields for n in _models_of(field.annotation, field.metadata)] or models
    return clean, sorted({name for m in models for name in m.model_fields})


def _without_tags(keys: list[str], model: type[pydantic.BaseModel]) -> list[str]:
    return _fields_at(keys, model)[0]


def _sibling_keys(keys: list[str], model: type[pydantic.BaseModel]) -> list[str]:
    return _fields_at(keys, model)[1]


def _models_of(annotation: Any, metadata: Sequence[Any]) -> list[type[pydantic.BaseModel]]:
    """Return the tables that an annotation allows: those that its metadata name, where they name some."""
    named = [table for one in metadata if isinstance(one, NamesTables) for table in one.tables.values()]
    return named or _models_in(annotation)


def _models_in(annotation: Any) -> list[type[pydantic.BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, pydantic.BaseModel):
        return [annotation]
    if get_origin(annotation) is Annotated:
        return _models_of(annotation.__origin__, annotation.__metadata__)
    inner = getattr(annotation, "__args__", ()) or getattr(annotation, "__value__", ())
    inner = inner if isinstance(inner, tuple) else (inner,)
    return [m for part in inner for m in _models_in(part)]


def _tags_of(model: type[pydantic.BaseModel]) -> set[str]:
    """Return the values of the field that tells the members of a union apart."""
    tag = model.model_fields.get("type")
    return set(getattr(tag.annotation, "__args__", ())) if tag else set()
