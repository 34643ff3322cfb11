"""An old name of `tuning.problem.build`, for one release."""

from vsajax.moved import old_names

__getattr__ = old_names(
    __name__, dict.fromkeys(("build", "build_estimator", "number", "with_leaves"), "tuning.problem.build")
)
