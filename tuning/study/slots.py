"""Slots: places in a study's tables that take one of several parts, told apart by their key `type`."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self, get_args

from pydantic import (
    Discriminator,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    Tag,
    TypeAdapter,
    create_model,
)
from pydantic import ValidationError as Invalid
from pydantic_core import CoreSchema, PydanticKnownError, ValidationError, core_schema

from tuning.files.toml import REFUSED, refusal
from tuning.study.parts.base import Part
from tuning.study.plugins import Origin, Refused
from tuning.study.registry import Registry

if TYPE_CHECKING:
    from pydantic_core import InitErrorDetails


class Slot[Own: Part](Registry[type[Own]]):
    """The parts that may stand in one place, as the metadata of an annotation: `Annotated[Part, SPRINGS]`.

    It validates, complains, dumps and describes itself as a closed union of its parts would, and takes those that
    are added later.

    Args:
        name: of the slot, e.g. "springs".
        base: what every part of it is.
        own: vsajax' parts, each with a key `type` that says its tag; or, where their tables have no such key, by
            tag.
        otherwise: the tag of a table without `type`.
    """

    def __init__(
        self,
        name: str,
        base: type[Own],
        *own: type[Own],
        untagged: Mapping[str, type[Own]] | None = None,
        otherwise: str | None = None,
    ):
        super().__init__(name, {**{_tag_of(part): part for part in own}, **(untagged or {})})
        self.base, self.otherwise = base, otherwise

    def only(self, tag: str) -> Self:
        """Return this slot with one of vsajax' own parts alone; what is added to one of the two is in both."""
        other = copy.copy(self)
        other._own, other.otherwise = {tag: self._own[tag]}, tag
        return other

    def of(self, *own: type[Own]) -> Self:
        """Return this slot with other parts of vsajax' own; what is added to one of the two is in both."""
        other = copy.copy(self)
        other._own = {_tag_of(part): part for part in own}
        return other

    @property
    def tables(self) -> Mapping[str, type[Part]]:
        """The parts that are here, by tag: what errors are told by."""
        return self.entries()

    def fitted(self, tag: str, entry: Any, origin: Origin | None) -> type[Own]:
        """Return a foreign part with its tag as the key `type`.

        Raises:
            Refused: it is no part of this slot.
        """
        if not (isinstance(entry, type) and issubclass(entry, self.base)):
            problem = f"got {tag!r}, which leads to {entry!r:.80}"
            raise Refused(
                problem, f"the {self.name} are subclasses of {self.base.__module__}:{self.base.__name__}"
            )
        told: dict[str, Any] = {"type": (Literal[tag], ...)}
        made = create_model(entry.__name__, __base__=entry, __module__=entry.__module__, **told)
        made.__doc__, made.origin = entry.__doc__, origin
        return made

    def validated(self, value: Any) -> Any:
        """Return the part that a table describes."""
        if isinstance(value, Part):
            return self._checked(value)
        if not isinstance(value, dict) and self.otherwise is None:
            raise PydanticKnownError("model_attributes_type")
        tag, part = self._chosen(value)
        try:
            return part.model_validate(value)
        except Invalid as error:
            # A closed union puts its tag into the path of what is wrong, and readers of errors go by it.
            place = () if len(self._own) == 1 and tag == self.otherwise else (tag,)
            raise ValidationError.from_exception_data(error.title, _moved(error, place)) from None

    def _chosen(self, value: Any) -> tuple[str, type[Part]]:
        tag = value.get("type", self.otherwise) if isinstance(value, dict) else self.otherwise
        if tag is None:
            raise PydanticKnownError("union_tag_not_found", {"discriminator": "'type'"})
        try:
            return str(tag), self.find(str(tag))
        except Refused as refused:
            own = self._own.get(self.otherwise or "")
            if own is not None and "type" not in own.model_fields and ":" not in str(tag):
                # Its table has no such key, and says so.
                return str(self.otherwise), own
            raise refusal("type", refused.problem, refused.fix) from None

    def _checked(self, part: Part) -> Part:
        if not isinstance(part, tuple(self.entries().values())):
            raise refusal("type", f"got a {type(part).__name__}", f"`vsajax parts {self.name}` lists what fits")
        return part

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        del source
        if len(self._own) > 1:
            return core_schema.no_info_plain_validator_function(self.validated)
        # With the one part inside, the field has the title of a plain table: none.
        (only,) = self._own.values()
        return core_schema.no_info_wrap_validator_function(
            lambda value, _: self.validated(value),
            handler.generate_schema(only),
            serialization=core_schema.simple_ser_schema("any"),
        )

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> Any:
        del schema
        # As an item of a list: what stands alone would be written out, and not be referred to by its name.
        return handler(TypeAdapter(_list_of(self._union())).core_schema)["items"]

    def _union(self) -> Any:
        parts = self.entries()
        if len(parts) == 1:
            return next(iter(parts.values()))
        if self.otherwise is None:
            return Annotated[_any_of(list(parts.values())), Field(discriminator="type")]
        tagged = [Annotated[part, Tag(tag)] for tag, part in parts.items()]
        return Annotated[_any_of(tagged), Discriminator(lambda table: table.get("type", self.otherwise))]


def _list_of(item: Any) -> Any:
    return list.__class_getitem__(item)


def _any_of(options: list[Any]) -> Any:
    union = options[0]
    for option in options[1:]:
        union = union | option
    return union


def _tag_of(part: type[Part]) -> str:
    (tag,) = get_args(part.model_fields["type"].annotation)
    return tag


def _moved(error: Invalid, place: tuple[str, ...]) -> list[InitErrorDetails]:
    """Return the mistakes of a part at their place below the slot's."""
    moved: list[InitErrorDetails] = []
    for item in error.errors(include_url=False):
        kind, context = item["type"], item.get("ctx", {})
        told = refusal(**context) if kind == REFUSED else kind
        moved.append({"type": told, "loc": (*place, *item["loc"]), "input": item["input"], "ctx": context})
    return moved
