"""What every part is held to: table and class agree, and what it computes is a pure function with slopes."""

from __future__ import annotations

import dataclasses
import math
import subprocess
import sys
import tomllib
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from tuning.problem.build import build
from tuning.study.base import to_toml
from tuning.study.extents import holds_number, range_in
from tuning.study.parts.base import Part, parts_in
from tuning.study.parts.catalog import SLOTS
from tuning.testing.probes import PROBES, Probe

_STEP = 1e-6
"""Relative step of finite differences."""
_SLOPE = 2e-3
"""Relative deviation of a slope from them that is still their own error."""
_FORBIDDEN = {
    "pure_callback",
    "io_callback",
    "debug_callback",
    "random_bits",
    "random_wrap",
    "cholesky",
    "lu",
    "eigh",
}
"""Operations that no robot has: calls of the host, random numbers, LAPACK."""


def check_part(part: type[Part], tables: Mapping[str, Any], *, slot: str | None = None) -> None:
    """Check that a part keeps the contract of its slot.

    The table's module must not import jax, its ranges are ranges, it survives being written and read, it has the
    fields of its class under the same names with the same defaults, and its numbers are float64 leaves, all but
    those that it names in `static`. What the class computes on the slot's example inputs is finite, the same when
    computed again, compiled or batched, and has the slopes that finite differences have. What else a slot asks
    for, e.g. that a spring's stiffness is the slope of its torque, is in `tuning.testing.probes`.

    Args:
        part: the class of the table.
        tables: a table of it as a file has it, without defaults; a key `type` is left out by what is foreign.
        slot: where it may stand, e.g. "springs"; vsajax' own parts are found where they are.

    Raises:
        AssertionError: says what does not hold.
    """
    name = part.__name__
    _check_module(part.__module__)
    table = part.model_validate(dict(tables))
    _check_ranges(part)
    assert part.model_validate(table.model_dump(exclude_none=True)) == table, f"{name}: a dump is another table"
    written = tomllib.loads(to_toml(table.model_dump(exclude_none=True)))
    assert part.model_validate(written) == table, f"{name}: written as TOML and read it is another table"
    _check_fields(table)
    built = build(table)
    _check_leaves(table, built, tables)
    where = _slot_of(part) if slot is None else slot
    if where is None:
        return
    assert where in SLOTS, f"{name}: there is no slot {where!r}; there are {', '.join(SLOTS)}"
    probe = PROBES[where]
    assert isinstance(built, probe.base), (
        f"{name}: builds a {type(built).__name__}, which is no {probe.base.__name__}"
    )
    probe.check(table, built)
    _check_function(name, built, probe)


def _slot_of(part: type[Part]) -> str | None:
    return next((name for name, slot in SLOTS.items() if part in slot.own().values()), None)


@cache
def _check_module(module: str) -> None:
    code = f"import sys, {module}; sys.exit('jax' in sys.modules)"
    environment = {"PYTHONPATH": ":".join(filter(None, sys.path))}
    ended = subprocess.run(
        [sys.executable, "-c", code], env=environment, check=False, capture_output=True, text=True
    )
    assert ended.returncode == 0, f"{module} imports jax: every `vsajax check` would wait for it\n{ended.stderr}"


def _check_ranges(part: type[Part]) -> None:
    for name, field in part.model_fields.items():
        if not holds_number(field.annotation):
            continue
        allowed, where = range_in(field), f"{part.__name__}.{name}"
        low = -math.inf if allowed.low is None else allowed.low
        high = math.inf if allowed.high is None else allowed.high
        assert low < high, f"{where}: nothing is allowed: {allowed.text}"
        if not field.is_required() and isinstance(field.default, int | float):
            assert math.isfinite(field.default), f"{where}: its default is not finite"
            assert low <= field.default <= high, f"{where}: its default {field.default} is not allowed"


def _check_fields(table: Part) -> None:
    name, cls = type(table).__name__, table.target.load()
    fields = {field.name for field in dataclasses.fields(cls)}
    assert fields == table.arguments().keys(), (
        f"{name}: has {sorted(table.arguments())}, its class {sorted(fields)}"
    )
    for inner in parts_in(table):
        assert inner.target.is_whole, f"{type(inner).__name__}: target is not of the form package.module:Name"


def _check_leaves(table: Part, built: Any, given: Mapping[str, Any]) -> None:
    part, cls = type(table), table.target.load()
    name = part.__name__
    assert type(built) is cls, f"{name}: builds a {type(built).__name__}, not a {cls.__name__}, as target says"
    if not table.files:
        plain = cls(**{key: build(getattr(table, key)) for key in given if key != "type"})
        assert eqx.tree_equal(built, plain), f"{name}: what it leaves out is not what its class leaves out"
    for leaf in jax.tree.leaves(built):
        assert isinstance(leaf, jax.Array), f"{name}: {leaf!r} is no array; use the converter vsajax.types.as_leaf"
        assert leaf.dtype == "float64", f"{name}: a number is {leaf.dtype}"
        assert not leaf.weak_type, f"{name}: a number is weakly typed; use the converter vsajax.types.as_leaf"
    loose = {field.name for field in dataclasses.fields(built) if isinstance(getattr(built, field.name), float)}
    assert part.static == loose, f"{name}: static says {sorted(part.static)}; no leaves are {sorted(loose)}"


def _check_function(name: str, built: Any, probe: Probe) -> None:
    numbers, rest = eqx.partition(built, eqx.is_inexact_array)

    def answer(values: Any) -> list[jax.Array]:
        found = jax.tree.leaves(probe.run(eqx.combine(values, rest)))
        return [jnp.asarray(one, float) for one in found]

    now = answer(numbers)
    assert now, f"{name}: computes nothing"
    for one in now:
        assert np.all(np.isfinite(one)), f"{name}: computes what is not finite"
    # It is traced a second time: what is not pure differs.
    compiled = jax.jit(answer)
    _compare(f"{name}: compiled", compiled(numbers), now, 1e-9)
    if jax.tree.leaves(numbers):
        several = jax.tree.map(lambda x: jnp.stack([x, 1.01 * x]), numbers)
        single = compiled(jax.tree.map(lambda x: 1.01 * x, numbers))
        _compare(f"{name}: batched", [x[1] for x in jax.jit(jax.vmap(answer))(several)], single, 1e-9)
        _check_slopes(name, compiled, numbers)
    if not probe.may_draw:
        used = _primitives(jax.make_jaxpr(answer)(numbers).jaxpr)
        assert not used & _FORBIDDEN, f"{name}: uses {sorted(used & _FORBIDDEN)}, which no robot has"


def _check_slopes(name: str, answer: Callable[[Any], list[jax.Array]], numbers: Any) -> None:
    leaves, shape = jax.tree.flatten(numbers)
    rng = np.random.default_rng(0)
    way = [jnp.where(x == 0.0, 1.0, x) * jnp.asarray(rng.uniform(0.5, 1.0, x.shape)) for x in leaves]
    direction = jax.tree.unflatten(shape, way)
    forward = jax.jit(lambda x, d: jax.jvp(answer, (x,), (d,))[1])(numbers, direction)
    ahead, behind = (
        answer(jax.tree.map(lambda x, d, h=h: x + h * d, numbers, direction)) for h in (_STEP, -_STEP)
    )
    for slope, high, low in zip(forward, ahead, behind, strict=True):
        difference = (high - low) / (2.0 * _STEP)
        assert np.all(np.isfinite(slope)), f"{name}: a slope is not finite"
        error = float(jnp.max(jnp.abs(slope - difference), initial=0.0))
        size = float(jnp.max(jnp.abs(difference), initial=0.0))
        # Differences of what they are taken of round to 1e-16 of it, divided by the step.
        rounding = 1e-7 * float(jnp.max(jnp.abs(high), initial=0.0))
        assert error <= _SLOPE * size + rounding, (
            f"{name}: a slope is {error:.3g} off finite differences ({size:.3g})"
        )
    backward = jax.jit(jax.grad(lambda values: sum(jnp.sum(x) for x in answer(values))))(numbers)
    for slope in jax.tree.leaves(backward):
        assert np.all(np.isfinite(slope)), f"{name}: a slope, computed backwards, is not finite"


def _compare(what: str, found: list[jax.Array], expected: list[jax.Array], relative: float) -> None:
    for one, other in zip(found, expected, strict=True):
        scale = float(jnp.max(jnp.abs(other), initial=0.0))
        worst = float(jnp.max(jnp.abs(one - other), initial=0.0))
        assert worst <= relative * scale, f"{what}, it is {worst:.3g} off, of {scale:.3g}"


def _primitives(jaxpr: Any) -> set[str]:
    found = set()
    for equation in jaxpr.eqns:
        found.add(equation.primitive.name)
        for value in equation.params.values():
            for inner in value if isinstance(value, list | tuple) else [value]:
                inner = getattr(inner, "jaxpr", inner)
                if hasattr(inner, "eqns"):
                    found |= _primitives(inner)
    return found
