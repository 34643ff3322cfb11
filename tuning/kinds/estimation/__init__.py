"""Estimation studies: a joint is moved, measured and its stiffness estimated."""
