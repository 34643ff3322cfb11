"""Recordings of real joints: what an estimator says of them, and its numbers tuned on them."""
