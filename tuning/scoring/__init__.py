"""Scores over scenarios: grids, populations, comparisons, and what can be said of them."""
