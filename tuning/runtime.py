"""An old name of `tuning.runs.machine`, for one release."""

from vsajax.moved import old_names

__getattr__ = old_names(__name__, {"start_jax": "tuning.runs.machine"})
