"""The header and the source of a generated program."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from tuning.exports.c99.expressions import Assign, Index, Loop, Number, Repeat, Storage, Type
from tuning.exports.c99.fusing import Block, Statement, Sums
from tuning.exports.c99.generate import Derived, Generated, member, storage_of
from tuning.exports.c99.limits import check_lines, refusals
from tuning.exports.c99.lowering import Code
from tuning.exports.c99.naming import identifier
from tuning.exports.c99.printing import FUNCTIONS, HELPERS, called, decimal, number, place, short, statement, sums
from tuning.exports.c99.rolling import roll
from tuning.exports.escaping import comment_of_c, string_of_c
from tuning.exports.layout import Field, Leaf, Record, Repeated, dotted
from tuning.exports.program import StepProgram
from tuning.exports.rendering import render
from vsajax import jumps
from vsajax.guard import LARGEST_READING

_ARGUMENTS = frozenset({"self", "in", "out", "first", "params", "refused", "turn", *"ijklmn"})
"""What no local variable may be called."""


@dataclass(frozen=True)
class Source:
    """A program as C99.

    Args:
        name: prefix of every public name, and the files' stem.
        header: text of ``name.h``.
        source: text of ``name.c``.
    """

    name: str
    header: str
    source: str


def write(program: StepProgram, generated: Generated, *, banner: str) -> Source:
    """Return the header and the source of a program.

    Args:
        program: described.
        generated: its statements.
        banner: a line that says where it comes from.
    """
    name = program.name
    structs = _Structs(name)
    params = structs.of("params", program.parameters.layout)
    state = structs.of("state", program.state.layout)
    inputs = structs.of("input", program.inputs.layout)
    outputs = structs.of("output", program.outputs.layout)
    derived = _derived_struct(name, generated.derived)
    has_clock, has_state = "dt" in program.inputs.names, bool(program.state.places)
    shared = {"name": name, "title": program.title, "banner": banner, "is_guarded": bool(program.guarded)}
    shared |= {"watched": len(program.watched), "patience": jumps.PATIENCE}
    shared |= {"factor": decimal(jumps.FACTOR), "least": decimal(jumps.LEAST)}
    header = render(
        "step.h",
        **shared,
        parameters=len(program.parameters.places),
        has_derived=bool(derived),
        has_state=has_state,
        has_clock=has_clock,
        structs="\n".join([*params, *state, *derived, *inputs, *outputs]),
    )
    prepare, init, step = (_body(code) for code in (generated.prepare, generated.init, generated.step))
    checked = check_lines(program)
    body = [
        *_tables(generated.step),
        f"void {name}_defaults({name}_params *params)\n{{\n{_lines(_defaults(program))}}}\n",
        f"static void prepare({name} *self)\n{{\n{_lines(prepare or ['(void)self;'])}}}\n",
        f"int {name}_check(const {name}_params *params)\n{{\n"
        f"{_lines([*_unused('params', checked), *checked])}}}\n",
        f"const char *{name}_refusal(int refused)\n{{\n{_lines(_refusal_lines(program))}}}\n",
        *_entries(program, init, step),
        f"int {name}_tune({name} *self, const {name}_params *params)\n{{\n{_lines(_TUNED)}}}\n".replace(
            "NAME", name
        ),
    ]
    text = "\n".join(body)
    functions = [(short(f), f) for f in sorted(set(FUNCTIONS.values())) if f"r_{short(f)}(" in text]
    helpers = [helper for operation, helper in HELPERS.items() if f"{called(operation)}(" in text]
    largest = decimal(LARGEST_READING)
    values = {"functions": functions, "helpers": helpers, "largest": largest, "body": text}
    return Source(name, header, render("step.c", **shared, **values))


def _entries(program: StepProgram, init: list[str], step: list[str]) -> Iterator[str]:
    """Yield the public functions of init and step: the statements themselves, or what guards them."""
    name = program.name
    instance, given = f"{name} *self", f"const {name}_input *in, {name}_output *out"
    advance = f"{_lines([*_unused('self', step), *step])}}}\n"
    if not program.guarded:
        begin = [*_taken(name), *_unused("first", init), *init, "return refused;"]
        yield (
            f"int {name}_init({instance}, const {name}_params *params, const {name}_input *first)\n{{\n"
            f"{_lines(begin)}}}\n"
        )
        yield f"void {name}_step({instance}, {given})\n{{\n{advance}"
        return
    if program.state.places:
        start = _lines([*_unused("self", init), *_unused("first", init), *init])
        yield f"static void start({instance}, const {name}_input *first)\n{{\n{start}}}\n"
    yield f"static void advance({instance}, {given})\n{{\n{advance}"
    readings = [
        {"place": member(path) + "".join(f"[i{n}]" for n in range(len(leaf.shape))), "shape": leaf.shape}
        for path, leaf in program.inputs.places
        if dotted(path) in program.guarded
    ]
    known = [member(path) for path, _ in program.outputs.places if path[-1] == "known"]
    values = {"name": name, "taken": _taken(name), "readings": readings, "known": known}
    values |= {"has_clock": "dt" in program.inputs.names, "has_state": bool(program.state.places)}
    values |= {"watched": [member(path) for path, _ in program.inputs.places if dotted(path) in program.watched]}
    yield render("guard.c", **values)


_TUNED = [
    "const int refused = NAME_check(params);",
    "if (refused == 0) {",
    "    self->params = *params;",
    "    prepare(self);",
    "}",
    "return refused;",
]


def _taken(name: str) -> list[str]:
    """Return lines that take over the parameters where they are in range, the exported ones where not."""
    return [
        f"const int refused = {name}_check(params);",
        "if (refused == 0) {",
        "    self->params = *params;",
        "} else {",
        f"    {name}_defaults(&self->params);",
        "}",
        "prepare(self);",
    ]


def _refusal_lines(program: StepProgram) -> list[str]:
    texts = [f'    "{string_of_c(text)}",' for text in refusals(program)]
    count = len(texts)
    lines = [f"static const char *const TEXTS[{count}] = {{", *texts, "};"]
    return [*lines, f'return refused >= 0 && refused < {count} ? TEXTS[refused] : "no such number";']


def _unused(name: str, lines: list[str]) -> list[str]:
    return [] if any(f"{name}->" in line for line in lines) else [f"(void){name};"]


def _lines(lines: list[str]) -> str:
    return "".join(f"    {line}\n" if line else "\n" for line in lines)


@dataclass
class _Structs:
    """Names the structs of one program; alike structs share a name, others of one class are numbered."""

    prefix: str

    def __post_init__(self) -> None:
        self.known: dict[str, str] = {}

    def of(self, name: str, layout: Record) -> list[str]:
        """Return the definitions of a struct and of all that it holds, innermost first; none of an empty one."""
        found: list[str] = []
        if layout.fields:
            self._define(layout, found, f"{self.prefix}_{name}")
        return found

    def _define(self, record: Record, found: list[str], wanted: str) -> str:
        members = []
        for name, field in record.fields.items():
            members += self._member(name, field, found)
        body = "".join(f"    {line}\n" for line in members)
        number, name = 1, wanted
        while self.known.get(name, body) != body:
            number += 1
            name = f"{wanted}_{number}"
        if name not in self.known:
            self.known[name] = body
            note = "".join(f"/* {line} */\n" for line in wrapped_words(comment_of_c(record.meaning), 94)[:3])
            found.append(f"{note}typedef struct {name} {{\n{body}}} {name};\n")
        return name

    def _member(self, name: str, field: Field, found: list[str]) -> list[str]:
        count = ""
        while isinstance(field, Repeated):
            count += f"[{field.count}]"
            field = field.of
        if isinstance(field, Record):
            inner = self._define(field, found, f"{self.prefix}_{field.name}")
            return [f"{inner} {identifier(name)}{count};"]
        kind = f"{self.prefix}_real" if field.kind == "real" else field.kind
        kind = "double" if field.is_sum else kind
        dimensions = count + "".join(f"[{n}]" for n in field.shape)
        return comment(f"{kind} {identifier(name)}{dimensions};", _remark(field))


def _remark(leaf: Leaf) -> str:
    unit = f" [{leaf.unit}]" if leaf.unit else ""
    return f"{leaf.meaning}{unit}".strip()


def comment(code: str, remark: str) -> list[str]:
    """Return a declaration with a remark behind it, or above where that is too long."""
    remark = comment_of_c(remark)
    if not remark:
        return [code]
    text = f"{code} /* {remark} */"
    if len(text) <= 96:
        return [text]
    return [f"/* {line} */" for line in wrapped_words(remark, 88)] + [code]


def wrapped_words(text: str, width: int) -> list[str]:
    """Break a text between words."""
    lines: list[str] = []
    for word in text.split():
        if lines and len(lines[-1]) + 1 + len(word) <= width:
            lines[-1] += f" {word}"
        else:
            lines.append(word)
    return lines


def _derived_struct(name: str, derived: tuple[Derived, ...]) -> list[str]:
    if not derived:
        return []
    types = {"real": f"{name}_real"}
    members = "".join(
        f"    {types.get(one.type, one.type)} {one.name}{''.join(f'[{n}]' for n in one.shape)};\n"
        for one in derived
    )
    return [f"/* What follows from the parameters alone; set by {name}_init and {name}_tune. */\n"
            f"typedef struct {name}_derived {{\n{members}}} {name}_derived;\n"]  # fmt: skip


def _defaults(program: StepProgram) -> list[str]:
    lines = []
    for (path, leaf), values in zip(program.parameters.places, program.defaults, strict=True):
        storage = storage_of(path, leaf, "params", "given")
        for index in np.ndindex(*leaf.shape):
            where = place(storage, tuple(Index(i) for i in index)).replace("params.", "params->", 1)
            lines.append(f"{where} = R({decimal(float(values[index]))});")
    return lines


def _tables(code: Code) -> Iterator[str]:
    for storage, array in code.tables:
        kind = {"real": "real", "int": "int", "bool": "bool"}[storage.type]
        dimensions = "".join(f"[{n}]" for n in storage.shape)
        yield f"static const {kind} {storage.name}{dimensions} = {_initialiser(array, storage.type)};\n"


def _initialiser(array: np.ndarray, kind: Type) -> str:
    if array.ndim > 1:
        return "{" + ", ".join(_initialiser(row, kind) for row in array) + "}"
    texts = [number(Number(float(x), kind))[0] for x in array]
    lines = wrapped_words(", ".join(texts), 92)
    return "{\n    " + "\n    ".join(lines) + "\n}" if len(lines) > 1 else "{" + lines[0] + "}"


Groups = dict[tuple[int, str, tuple[int, ...], str], list[Storage]]


def _grouped(statements: Sequence[Assign | Repeat], scope: int, groups: Groups) -> Groups:
    """Return the variables of one statement of the source, of one shape, that are declared in one place."""

    def join(one: Storage) -> None:
        known = any(other is one for members in groups.values() for other in members)
        if one.is_local and not known:
            groups.setdefault((scope, one.group, one.shape, one.declared), []).append(one)

    for s in statements:
        if isinstance(s, Assign):
            join(s.target)
            continue
        for one in s.collected:
            join(one)
        _grouped(s.body, id(s), groups)
    return groups


def _name_locals(statements: Sequence[Assign | Repeat]) -> tuple[dict[str, str], set[str]]:
    """Give locals their names, those of one statement of the source one array.

    Returns:
        The declarations of what is not declared where it is written, and all names.
    """
    taken: Counter[str] = Counter()
    declared: dict[str, str] = {}
    names = set()
    for members in _grouped(statements, 0, {}).values():
        base = identifier(members[0].name)
        base = f"{base}_value" if base in _ARGUMENTS else base
        taken[base] += 1
        name = base if taken[base] == 1 else f"{base}_{taken[base]}"
        first = members[0]
        dimensions = (len(members), *first.shape) if len(members) > 1 else first.shape
        for n, one in enumerate(members):
            one.name, one.indices = name, (Index(n),) if len(members) > 1 else ()
        if dimensions or first.role == "carried":
            declared[name] = f"{first.declared} {name}{''.join(f'[{n}]' for n in dimensions)};"
        names.add(name)
    return declared, names


def _body(code: Code) -> list[str]:
    """Return the lines of a function."""
    return _Body(*_name_locals(code.statements)).lines(code.fused)


@dataclass
class _Body:
    """Writes statements, each array declared where it is first written.

    Args:
        declared: declarations by name, of what is not written yet.
        taken: names that are in use.
    """

    declared: dict[str, str]
    taken: set[str]
    place: str = ""

    def lines(self, statements: Sequence[Statement]) -> list[str]:
        """Return the lines of statements and of the loops around some of them."""
        lines: list[str] = []
        plain: list[Assign] = []
        for one in [*statements, None]:
            if isinstance(one, Assign):
                plain.append(one)
                continue
            lines += self._plain(plain, is_first=not lines)
            plain = []
            if isinstance(one, Sums):
                lines += self._head(one.body[0], is_first=not lines)
                lines += [line for s in one.body for line in self._declaration(s)]
                lines += sums(one.body, one.loop, [self._is_number(s) for s in one.body])
            if isinstance(one, Block):
                lines += [
                    self.declared.pop(s.target.name)
                    for s in one.body
                    if s.target.role == "local" and not s.target.is_inner and s.target.name in self.declared
                ]
                lines += _loop(one.loop, self.lines(one.body))
            if isinstance(one, Repeat):
                lines += self._head(one, is_first=not lines)
                lines += [self.declared.pop(c.name) for c in one.collected if c.name in self.declared]
                lines += _loop(one.loop, self.lines(one.fused))
        return lines

    def _plain(self, statements: list[Assign], *, is_first: bool) -> list[str]:
        lines: list[str] = []
        for s in roll(statements, self.taken):
            lines += self._head(s, is_first=is_first and not lines)
            lines += self._declaration(s)
            lines += statement(s, declare=self._is_number(s))
        return lines

    def _head(self, s: Assign | Repeat, *, is_first: bool) -> list[str]:
        if not s.place or s.place == self.place:
            return []
        self.place = s.place
        return ([] if is_first else [""]) + [f"/* {s.place} */"]

    def _declaration(self, s: Assign) -> list[str]:
        is_due = s.target.is_local and s.target.name in self.declared
        return [self.declared.pop(s.target.name)] if is_due else []

    def _is_number(self, s: Assign) -> bool:
        return s.target.role == "local" and not s.target.shape and not s.target.indices


def _loop(loop: Loop, body: list[str]) -> list[str]:
    variable, start, end = loop
    head = f"for (int {variable} = {start}; {variable} < {end}; ++{variable}) {{"
    return [head, *(f"    {line}" if line else "" for line in body), "}"]


__all__ = ["Source", "member", "write"]
