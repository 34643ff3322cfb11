"""Scalar mathematics that compiles to fast scan bodies: no LAPACK, no library call per lane."""

from vsajax.numerics.functions import damped_response, logistic, safe_divide, safe_sqrt, smooth_sign, with_slope
from vsajax.numerics.fusion import once
from vsajax.numerics.linear import solve_definite
from vsajax.numerics.rows import (
    Rows,
    combine_rows,
    dot,
    rank_one_downdate,
    scaled_identity,
    scaled_symmetric_part,
)
from vsajax.numerics.trigonometry import cos, sin

__all__ = [
    "Rows",
    "combine_rows",
    "cos",
    "damped_response",
    "dot",
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
    "with_slope",
]
