"""Scalar mathematics that compiles to fast scan bodies: no LAPACK, no library call per lane."""

from vsajax.numerics.elimination import solve_square
from vsajax.numerics.functions import damped_response, logistic, safe_divide, safe_sqrt, smooth_sign, with_slope
from vsajax.numerics.fusion import once
from vsajax.numerics.lanes import apply, apply_transposed, identity_like, lanes_last, lanes_minor
from vsajax.numerics.linear import solve_definite
from vsajax.numerics.products import (
    Matrix,
    Vector,
    dot,
    rank_one_downdate,
    scaled_symmetric_part,
    sum_of_squares,
    symmetric_product,
    trace,
)
from vsajax.numerics.sweep import inverse, symmetric_part
from vsajax.numerics.trigonometry import cos, sin

__all__ = [
    "Matrix",
    "Vector",
    "apply",
    "apply_transposed",
    "cos",
    "damped_response",
    "dot",
    "identity_like",
    "inverse",
    "lanes_last",
    "lanes_minor",
    "logistic",
    "once",
    "rank_one_downdate",
    "safe_divide",
    "safe_sqrt",
    "scaled_symmetric_part",
    "sin",
    "smooth_sign",
    "solve_definite",
    "solve_square",
    "sum_of_squares",
    "symmetric_part",
    "symmetric_product",
    "trace",
    "with_slope",
]
