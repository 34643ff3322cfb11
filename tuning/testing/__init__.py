"""The contract of a part, as tests: what vsajax holds its own parts to, for those of others."""

from tuning.testing.contract import check_part

__all__ = ["check_part"]
