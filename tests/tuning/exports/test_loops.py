"""Loops of fixed length, looked-up places and extremes: each tiny, in C as in jax to the last bits."""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.tuning.exports.native import answers_of, needs_compiler, replay
from tuning.exports.c99.expressions import Index, Number, Position, Read, Repeat, Storage
from tuning.exports.c99.files import write
from tuning.exports.c99.generate import generate
from tuning.exports.c99.printing import expression
from tuning.exports.program import trace
from vsajax import numerics, rollout
from vsajax.solvers import eigen
from vsajax.types import as_leaf


class Weights(eqx.Module):
    """Parameters of nothing."""

    gain: Any = eqx.field(converter=as_leaf, default=0.3)


class Table(NamedTuple):
    """An input."""

    values: Any


class Result(NamedTuple):
    """An output."""

    values: Any


class Nothing(NamedTuple):
    """No state."""


def summed(p, x):
    """Carry two values and collect a row a turn."""

    def turn(carry, row):
        total, last = carry
        return (total * p.gain + row, total), jnp.stack([total, last + row[1]])

    (total, last), rows = jax.lax.scan(turn, (x[0], x[1] * 0.0), x)
    return jnp.stack([total, last, rows.sum(0).sum(0)])


def backwards(p, x):
    return jax.lax.scan(lambda c, row: (c * 0.5 + row.sum(), c - row[0]), x[0, 0], x, reverse=True)[1]


def counted(p, x):
    return jax.lax.fori_loop(0, 5, lambda i, a: a * p.gain + i * x[0], x[1])


def nested(p, x):
    def outer(a):
        inner = rollout.repeat(lambda b: b * 0.5 + a, x, times=3)
        return inner.T @ inner * p.gain

    return rollout.repeat(outer, x @ x.T, times=2)


def exchanged(p, x):
    def turn(pair):
        a, b = pair
        return b, a + p.gain * b

    return sum(rollout.repeat(turn, (x, 2.0 * x), times=4))


def alike(p, x):
    """Compute within the turns what is the same in each, and carry what nothing reads."""

    def turn(state):
        a, idle = state
        return a + jnp.sqrt(jnp.abs(x)) * p.gain, idle + a

    return rollout.repeat(turn, (x, x), times=3)[0]


def reordered(p, x):
    return x[np.array([2, 0, 1])][:, np.array([1, 1, 0])]


def looked_up(p, x):
    return x[jnp.argmax(jnp.abs(x[:, 0]))] + jnp.take(x, jnp.argmin(x[1]), axis=1)


def outside(p, x):
    place = jnp.floor(4.0 * x[0, 0]).astype(int)
    dropped = jnp.where(jnp.isnan(x[place]), 7.0, x[place])
    return dropped + x.at[place].get(mode="clip")


def sliced(p, x):
    place = jnp.floor(4.0 * x[0, 0]).astype(int)
    part = jax.lax.dynamic_slice(x, (place, 0), (2, 3))
    return jax.lax.dynamic_update_slice(x, 10.0 * part[:1], (1 - place, place))


def extremes(p, x):
    odd = jnp.where(x > 1.0, jnp.nan, x)
    same = jnp.round(x)
    places = jnp.stack([jnp.argmax(odd, axis=1), jnp.argmin(odd, axis=1), jnp.argmax(same, axis=0)])
    return places + jnp.prod(x) + jnp.where((x > 0.0).any(), 0.25, 0.0) + jnp.where((x < 1.0).all(1), 0.5, 0.0)


def reshaped(p, x):
    flat = (x * p.gain).reshape(9)
    return flat[1:7].reshape(3, 2, 1).sum(0) + flat[:4].reshape(2, 2) @ flat[5:9].reshape(4)[:2]


def solved(p, x):
    return numerics.solve_square(x, x.T @ x)


def spectrum(p, x):
    return eigen(x + x.T)[0]


STEPS = [summed, backwards, counted, nested, exchanged, alike, reordered, looked_up, outside, sliced]
STEPS += [extremes, reshaped, solved, spectrum]


def program_of_step(step):
    def init(module, sample):
        return Nothing()

    def whole(module, state, sample):
        return state, Result(step(module, sample.values))

    return trace("toy", "a toy", Weights(), Table(jnp.ones((3, 3))), init, whole), init, whole


@needs_compiler
@pytest.mark.equivalence
@pytest.mark.parametrize("step", STEPS)
def test_c_loops_and_looks_up_as_jax_does(step, tmp_path):
    program, init, whole = program_of_step(step)
    samples = Table(jnp.asarray(np.random.default_rng(5).normal(size=(50, 3, 3))))
    golden = answers_of(program, Weights(), whole, init, samples)
    worst = replay(program, golden, tmp_path, "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    assert max(worst.values()) < 1e-11, worst


@pytest.mark.structure
def test_a_loop_stays_one_and_its_turns_are_counted():
    generated = generate(program_of_step(alike)[0])
    loops = [one for one in generated.step.statements if isinstance(one, Repeat)]
    assert [one.loop for one in loops] == [("turn", 0, 3)]
    # What is alike in every turn is computed once, and what nothing reads is not carried.
    assert generated.operations["sqrt"] == 9
    assert generated.operations["add"] == 3 * 9
    text = write(program_of_step(alike)[0], generated, banner="a test").source
    assert text.count("for (int turn = 0; turn < 3; ++turn) {") == 1


def test_indices_add_up_and_are_written_as_c():
    pivot = Read(Storage("pivot", (), (), "int", "local"), ())
    looked = Index(chosen=pivot)
    for index, text in (
        (Index(2).plus(Index(3)), "5"),
        (Index(0, "i").plus(Index(1)), "i + 1"),
        (Index(0, "i", 3).plus(looked).shifted(-1), "3 * i + pivot - 1"),
        (Index(1, "i").plus(Index(2, "j")), "i + j + 3"),
        (looked.scaled(3).plus(Index(0, "j")), "j + pivot * 3"),
    ):
        assert expression(Position(index)) == text
    assert Index(4).expression() == Number(4, "int")
