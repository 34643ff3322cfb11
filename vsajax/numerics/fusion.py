"""Telling the compiler what to compute once.

XLA's CPU backend fuses an expression into every expression that reads it, and computes it again in each: what 18
coefficients read is computed 18 times a sample. Where a value is dearer than a load and read by several, the step
marks it.
"""

from __future__ import annotations

import jax


def once[Tree](values: Tree) -> Tree:
    """Return `values` as they are, computed once and stored before anything reads them.

    Derivatives and batching pass through; values that are not batched stay so.
    """
    return jax.lax.optimization_barrier(values)
