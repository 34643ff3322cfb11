"""From flat equations to statements: what is stored, what is an expression, and what can be written in place.

A value is stored where the source says so (`once`), where several read it, or where a larger array would compute
it again for every element; anything else is part of the expression that reads it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from tuning.exports.c99.expressions import (
    Apply,
    Assign,
    Expression,
    Index,
    Loop,
    Number,
    Position,
    Read,
    Repeat,
    Storage,
    Type,
    assigns,
    reads,
    rewritten,
    size,
)
from tuning.exports.c99.fusing import Statement
from tuning.exports.c99.primitives import EXTREMES, REDUCTIONS, is_view, lower, type_of
from tuning.exports.c99.values import Value, stored
from tuning.exports.c99.widths import is_wide
from tuning.exports.flatten import Atom, Equation, Flat, Origin, Symbol, Turns

_LONGEST = 48
"""Operations of an expression, above which it is cut."""
_FREE = 2
"""Operations up to which what follows from the place alone, such as a unit matrix, is not worth storing."""
_NAMED = 6
"""Operations from which a value that the source names is stored under that name."""
_READ_AGAIN = frozenset({"square", "integer_pow", "scan"})
"""Operations that read what they are given more than once."""
_VARIABLES = "ijklmn"


@dataclass
class Code:
    """Statements, the constant arrays that they read, and in the end the same statements with long loops fused."""

    statements: list[Assign | Repeat] = field(default_factory=list)
    tables: list[tuple[Storage, np.ndarray]] = field(default_factory=list)
    fused: list[Statement] = field(default_factory=list)


def loops_over(shape: Sequence[int], taken: int = 0) -> tuple[tuple[Index, ...], tuple[Loop, ...]]:
    """Return indices into an array, and the loops that run over it; a dimension of one needs none."""
    indices, loops = [], []
    for n in shape:
        if n == 1:
            indices.append(Index(0))
            continue
        variable = _VARIABLES[taken + len(loops)]
        indices.append(Index(0, variable))
        loops.append((variable, 0, n))
    return tuple(indices), tuple(loops)


@dataclass
class Lowering:
    """Lowers one function.

    Args:
        flat: its equations.
        known: values of symbols that are there already.
        code: what it adds to.
        results: places of the function's results, by position.
        depth: how many loops of the source it is in.
    """

    flat: Flat
    known: dict[int, Value]
    code: Code
    results: dict[int, Storage]
    depth: int = 0

    def __post_init__(self) -> None:
        self.uses: Counter[int] = Counter()
        self.origins: dict[int, Origin] = {}
        self.readers: dict[int, Equation] = {}
        self.widened: set[int] = set()
        for equation in self.flat.equations:
            result = max((int(np.prod(s.shape)) for s in equation.outputs), default=1)
            for symbol in equation.outputs:
                # What is computed once is named by what computes it.
                inner = self.origins.get(id(equation.inputs[0])) if equation.primitive == "once" else None
                self.origins[id(symbol)] = inner or equation.origin
            for atom in equation.inputs:
                self.readers[id(atom)] = equation
                self.uses[id(atom)] += 2 if equation.primitive in _READ_AGAIN else 1
                is_widened = int(np.prod(atom.shape)) < result and equation.primitive != "concatenate"
                if is_widened or equation.primitive == "unstack":
                    self.widened.add(id(atom))
        for atom in self.flat.outputs:
            self.uses[id(atom)] += 1
        self.targets: dict[int, Storage] = {}
        for position, atom in enumerate(self.flat.outputs):
            if isinstance(atom, Symbol) and position in self.results:
                self.targets.setdefault(id(atom), self.results[position])

    def run(self) -> dict[int, Value]:
        """Lower all equations, put the results in their places, and return the value of every symbol."""
        for equation in self.flat.equations:
            self.equation(equation)
        for position, atom in enumerate(self.flat.outputs):
            if position in self.results:
                self._deliver(self.value(atom), self.results[position])
        return self.known

    def keep(self, symbol: Symbol, storage: Storage) -> None:
        """Copy a value from a local variable to storage that is still there when the function has returned."""
        value = self.known[id(symbol)]
        if any(read.storage.is_local for read in reads(value.at(loops_over(value.shape)[0]))):
            self._deliver(value, storage)
            self.known[id(symbol)] = stored(storage)

    def value(self, atom: Atom) -> Value:
        """Return the value of a symbol or a constant."""
        if isinstance(atom, Symbol):
            return self.known[id(atom)]
        return self._constant(atom)

    def equation(self, equation: Equation) -> None:
        """Lower one equation."""
        given = [self.value(atom) for atom in equation.inputs]
        if equation.primitive == "scan":
            self._repeat(equation, given)
            return
        if equation.primitive in EXTREMES:
            self.known[id(equation.outputs[0])] = self._choose(equation, given[0])
            return
        if equation.primitive in REDUCTIONS:
            self.known[id(equation.outputs[0])] = self._reduce(equation, given[0])
            return
        if equation.primitive == "dot_general":
            self.known[id(equation.outputs[0])] = self._contract(equation, given)
            return
        if not is_view(equation):
            # Only a view may look into pieces, and only at constant places.
            given = [self._whole(value, equation) for value in given]
        for symbol, value in zip(equation.outputs, lower(equation, given), strict=True):
            if self._is_stored(equation, symbol, value):
                value = self._store(value, symbol, equation)
            self.known[id(symbol)] = value

    def _is_stored(self, equation: Equation, symbol: Symbol, value: Value) -> bool:
        if value.pieces or equation.primitive == "element":
            return True
        first = value.at(loops_over(value.shape)[0])
        operations = size(first)
        if not operations or (operations <= _FREE and not reads(first)):
            return False
        if equation.primitive == "once" or id(symbol) in self.targets or operations > _LONGEST:
            return True
        if self.uses[id(symbol)] > 1 or id(symbol) in self.widened:
            return True
        reader = self.readers.get(id(symbol))
        is_named = reader is not None and reader.origin.statement != equation.origin.statement
        return is_named and operations >= _NAMED and reader is not None and reader.primitive != "once"

    def _store(self, value: Value, symbol: Symbol, equation: Equation) -> Value:
        origin = self.origins[id(symbol)]
        storage = self.targets.get(id(symbol)) or self._local(value, origin)
        if storage.is_local and not value.pieces:
            storage.is_wide = is_wide(value.at(loops_over(value.shape)[0]))
        self._assign(value, storage, origin.place)
        return stored(storage)

    def _local(self, value: Value, origin: Origin) -> Storage:
        return Storage(origin.name, (), value.shape, value.type, "local", origin.statement or origin.name)

    def _whole(self, value: Value, equation: Equation) -> Value:
        if not value.pieces:
            return value
        storage = self._local(value, equation.origin)
        self._assign(value, storage, equation.origin.place)
        return stored(storage)

    def _assign(self, value: Value, storage: Storage, place: str, at: tuple[int, ...] = ()) -> None:
        """Store an array, piece by piece where it has pieces."""
        offsets = at or (0,) * len(value.shape)
        if value.pieces:
            # From the end: what is shifted up must be read before it is written over.
            for piece in reversed(value.pieces):
                moved = list(offsets)
                moved[piece.axis] += piece.start
                self._assign(piece.value, storage, place, tuple(moved))
            return
        indices, loops = loops_over(value.shape)
        target = tuple(index.shifted(offset) for index, offset in zip(indices, offsets, strict=True))
        self.code.statements.append(Assign(storage, target, value.at(indices), loops, place=place))

    def _reduce(self, equation: Equation, value: Value) -> Value:
        axes = equation.params["axes"]
        value = self._whole(value, equation)
        outer, loops = loops_over(equation.outputs[0].shape)
        inner, sums = loops_over([value.shape[axis] for axis in axes], len(loops))
        kept, summed = iter(outer), iter(inner)
        indices = tuple(next(summed) if axis in axes else next(kept) for axis in range(len(value.shape)))
        return self._accumulate(
            equation, value.at(indices), value, outer, loops, sums, REDUCTIONS[equation.primitive]
        )

    def _choose(self, equation: Equation, value: Value) -> Value:
        """Lower argmax or argmin: the first place of the extreme, or of a number that is none."""
        (axis,) = equation.params["axes"]
        value = self._stored_whole(value, equation)
        outer, loops = loops_over(equation.outputs[0].shape)
        (candidate,), turns = loops_over([value.shape[axis]], len(loops))
        storage = self._place_of(equation)

        def at(index: Index) -> Expression:
            return value.at((*outer[:axis], index, *outer[axis:]))

        mine, best = at(candidate), at(Index(chosen=Read(storage, outer)))
        is_better = Apply(EXTREMES[equation.primitive], (mine, best), "bool")
        if value.type == "real":
            is_none, has_none = (Apply("ne", (one, one), "bool") for one in (mine, best))
            is_first = Apply("and", (is_none, Apply("not", (has_none,), "bool")), "bool")
            is_better = Apply("or", (is_better, is_first), "bool")
        choice = Apply("select", (is_better, candidate.expression(), Read(storage, outer)), "int")
        self.code.statements.append(Assign(storage, outer, choice, loops, turns, "place", equation.origin.place))
        return stored(storage)

    def _stored_whole(self, value: Value, equation: Equation) -> Value:
        """Return a value whose elements are places, so that they can be read at any index."""
        if not value.pieces and isinstance(value.at(loops_over(value.shape)[0]), Read):
            return value
        storage = self._local(value, equation.origin)
        self._assign(value, storage, equation.origin.place)
        return stored(storage)

    def _repeat(self, equation: Equation, given: list[Value]) -> None:
        """Lower a loop of fixed length: what it carries lies in variables, what it collects in arrays."""
        turns: Turns = equation.params["turns"]
        body, origin = turns.body, equation.origin
        variable = "turn" if not self.depth else f"turn_{self.depth + 1}"
        row = Index(turns.length - 1, variable, -1) if turns.is_reversed else Index(0, variable)
        known = dict(self.known)
        outside = zip(equation.inputs[len(body.inputs) :], given[len(body.inputs) :], strict=True)
        known |= {id(atom): self._whole(value, equation) for atom, value in outside}
        rows = zip(body.inputs[turns.carried :], given[turns.carried : len(body.inputs)], strict=True)
        for symbol, value in rows:
            known[id(symbol)] = _row_of(self._whole(value, equation), row, symbol.shape)
        held, following = [], []
        for n, symbol in enumerate(body.inputs[: turns.carried]):
            storage = self._carried(equation.outputs[n], n, origin)
            self._assign(given[n], storage, origin.place)
            known[id(symbol)] = self.known[id(equation.outputs[n])] = stored(storage)
            held.append(storage)
            following.append(Storage(f"following {self.depth} {n}", (), symbol.shape, storage.type, "result"))
        code = Code(tables=self.code.tables)
        inner = Lowering(body, known, code, dict(enumerate(following)), self.depth + 1)
        inner.run()
        collected = []
        for n, symbol in enumerate(equation.outputs[turns.carried :], turns.carried):
            storage = self._carried(symbol, n, origin)
            value = inner._whole(inner.value(body.outputs[n]), equation)
            indices, loops = loops_over(value.shape)
            code.statements.append(Assign(storage, (row, *indices), value.at(indices), loops, place=origin.place))
            self.known[id(symbol)] = stored(storage)
            collected.append(storage)
        settle(code, list(zip(held, following, strict=True)))
        loop = (variable, 0, turns.length)
        self.code.statements.append(Repeat(loop, code.statements, origin.place, collected))

    def _carried(self, symbol: Symbol, n: int, origin: Origin) -> Storage:
        """Return a variable that outlives the turns of a loop, named as the source does where it names each."""
        name = origin.names[n] if len(origin.names) > n else origin.name
        return Storage(name, (), symbol.shape, type_of(symbol.dtype), "carried", f"carried {origin.statement}")

    def _contract(self, equation: Equation, given: list[Value]) -> Value:
        left, right = (self._whole(value, equation) for value in given)
        (left_axes, right_axes), batch_axes = equation.params["dimension_numbers"]
        outer, loops = loops_over(equation.outputs[0].shape)
        inner, sums = loops_over([left.shape[axis] for axis in left_axes], len(loops))
        shared = len(batch_axes[0])
        rest = iter(outer[shared:])
        sides = []
        for value, axes, batched in ((left, left_axes, batch_axes[0]), (right, right_axes, batch_axes[1])):
            places = [Index(0)] * len(value.shape)
            for n, axis in enumerate(batched):
                places[axis] = outer[n]
            for n, axis in enumerate(axes):
                places[axis] = inner[n]
            for axis in range(len(places)):
                if axis not in axes and axis not in batched:
                    places[axis] = next(rest)
            sides.append(value.at(tuple(places)))
        product = Apply("mul", (sides[0], sides[1]), left.type)
        return self._accumulate(equation, product, left, outer, loops, sums, "sum")

    def _accumulate(
        self,
        equation: Equation,
        expression: Expression,
        value: Value,
        outer: tuple[Index, ...],
        loops: tuple[Loop, ...],
        sums: tuple[Loop, ...],
        combine: str,
    ) -> Value:
        storage = self._place_of(equation)
        self.code.statements.append(
            Assign(storage, outer, expression, loops, sums, combine, equation.origin.place)
        )
        return stored(storage)

    def _place_of(self, equation: Equation) -> Storage:
        """Return where the result of an equation goes."""
        symbol, origin = equation.outputs[0], equation.origin
        local = Storage(origin.name, (), symbol.shape, type_of(symbol.dtype), "local", origin.statement)
        return self.targets.get(id(symbol)) or local

    def _constant(self, array: np.ndarray) -> Value:
        kind = type_of(array.dtype)
        if array.size and np.array_equal(array, np.full_like(array, array.flat[0]), equal_nan=kind == "real"):
            number = Number(float(array.flat[0]), kind)
            return Value(array.shape, kind, lambda _: number)
        if array.ndim == 1 and np.count_nonzero(array) == 1 and kind == "real":
            return _one_hot(array)
        storage = self._table(array, kind)

        def at(indices: tuple[Index, ...]) -> Expression:
            if all(index.is_constant for index in indices):
                return Number(float(array[tuple(index.offset for index in indices)]), kind)
            return Read(storage, indices)

        return Value(array.shape, kind, at)

    def _table(self, array: np.ndarray, kind: Type) -> Storage:
        for storage, known in self.code.tables:
            if known.dtype == array.dtype and np.array_equal(known, array):
                return storage
        storage = Storage(f"TABLE_{len(self.code.tables)}", (), array.shape, kind, "given")
        self.code.tables.append((storage, array))
        return storage

    def _deliver(self, value: Value, storage: Storage) -> None:
        """Put a result in its place unless it is there already."""
        indices, _ = loops_over(value.shape)
        expression = value.at(indices) if not value.pieces else None
        if isinstance(expression, Read) and expression.storage.is_same(storage) and expression.indices == indices:
            return
        self._assign(value, storage, "")


def _one_hot(array: np.ndarray) -> Value:
    """Return the value of a row with a single number in it."""
    (place,) = np.nonzero(array)[0]
    number = Number(float(array[place]), "real")

    def at(indices: tuple[Index, ...]) -> Expression:
        if indices[0].is_constant:
            return number if indices[0].offset == place else Number(0.0, "real")
        is_here = Apply("eq", (Position(indices[0]), Position(Index(int(place)))), "bool")
        return Apply("select", (is_here, number, Number(0.0, "real")), "real")

    return Value(array.shape, "real", at)


def _row_of(value: Value, row: Index, shape: tuple[int, ...]) -> Value:
    """Return one row of an array."""
    return Value(shape, value.type, lambda indices: value.at((row, *indices)))


def settle(code: Code, state: Sequence[tuple[Storage, Storage]]) -> None:
    """Decide for every part of the state whether its next value may be written over it at once.

    It may where nothing reads the old value later, and where the statements that write it read it only at the
    same place, or, shifting it up, from the end. Otherwise the next value waits in a local variable.

    Args:
        code: its statements are changed.
        state: the old and the next storage of every part of the state.
    """
    tail: list[Assign] = []
    for old, new in state:
        writers = [n for n, s in enumerate(code.statements) if isinstance(s, Assign) and s.target is new]
        if not writers:
            continue
        last_read = max((n for n, s in enumerate(code.statements) if _reads(s, old)), default=-1)
        statements = [code.statements[n] for n in writers]
        in_place = last_read <= writers[-1] and all(
            isinstance(statement, Assign) and _reads_only_here(statement, old) for statement in statements
        )
        if in_place and len(writers) > 1:
            in_place = last_read <= writers[0] and all(b - a == 1 for a, b in pairwise(writers))
        if in_place:
            _redirect(code.statements, new, old)
            continue
        base = old.name.rpartition(".")[2]
        new.name, new.indices, new.role = f"next_{base}", (), "local"
        new.group = f"next {old.group or old.name}"
        indices, loops = loops_over(old.shape)
        tail.append(Assign(old, indices, Read(new, indices), loops))
    code.statements += tail


def _reads(statement: Assign | Repeat, storage: Storage) -> bool:
    return any(read.storage.is_same(storage) for s in assigns([statement]) for read in reads(s.value))


def _redirect(statements: Sequence[Assign | Repeat], new: Storage, old: Storage) -> None:
    """Write and read the next value where the old one was."""
    for s in assigns(statements):
        s.value = rewritten(s.value, lambda r: Read(old, r.indices) if r.storage is new else r)
        if s.target is new:
            s.target = old


def _reads_only_here(statement: Assign, old: Storage) -> bool:
    """Return whether a statement reads the old value only where it writes, or from lower indices downwards."""
    for read in reads(statement.value):
        if not read.storage.is_same(old):
            continue
        if statement.inner or not statement.loops:
            if read.indices != statement.indices:
                return False
            continue
        shifts = [
            target.offset - source.offset
            for target, source in zip(statement.indices, read.indices, strict=True)
            if (target.variable, target.scale, target.chosen) == (source.variable, source.scale, source.chosen)
        ]
        if len(shifts) != len(statement.indices) or any(shift != 0 for shift in shifts[1:]) or shifts[0] < 0:
            return False
        if shifts[0] > 0 and not isinstance(statement.value, Read):
            return False
    return True
