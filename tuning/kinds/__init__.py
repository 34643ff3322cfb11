"""The kinds of study: a folder a kind, each behind the same interface."""
