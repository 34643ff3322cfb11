"""Gasparri et al.: variable stiffness control for oscillation damping."""
