"""Scalar mathematics that compiles to fast scan bodies: no LAPACK, no library call per lane."""

from vsajax.numerics.elimination import solve_square
from vsajax.numerics.functions import damped_response, logistic, safe_divide, safe_sqrt, smooth_sign, with_slope
from vsajax.numerics.fusion import once
from vsajax.numerics.lanes import apply, apply_transposed, identity_like, lanes_last
from vsajax.numerics.linear import solve_definite
from vsajax.numerics.rows import (
    Rows,
    combine_rows,
    dot,
    rank_one_downdate,
    scaled_identity,
    scaled_symmetric_part,
)
from vsajax.numerics.sweep import inverse, symmetric_part
from vsajax.numerics.trigonometry import cos, sin

__all__ = [
    "Rows",
    "apply",
    "apply_transposed",
    "combine_rows",
    "cos",
    "damped_response",
    "dot",
    "identity_like",
    "inverse",
    "lanes_last",
    "logistic",
    "once",
    "rank_one_downdate",
    "safe_divide",
    "safe_sqrt",
    "scaled_identity",
    "scaled_symmetric_part",
    "sin",
    "smooth_sign",
    "solve_definite",
    "solve_square",
    "symmetric_part",
    "with_slope",
]
