"""Least squares within a box and eigenvalues, by iterations of fixed length: they compile, and export to C."""

from vsajax.solvers.active_set import ActiveSet
from vsajax.solvers.box import AbstractBoxSolver, BoxLeastSquares, BoxSolution
from vsajax.solvers.enumeration import Enumeration
from vsajax.solvers.interior_point import InteriorPoint
from vsajax.solvers.spectrum import eigen, inverse

__all__ = [
    "AbstractBoxSolver",
    "ActiveSet",
    "BoxLeastSquares",
    "BoxSolution",
    "Enumeration",
    "InteriorPoint",
    "eigen",
    "inverse",
]
