"""What a kind of study gives the methods: scenarios, and what comes of them."""

from vsajax.moved import old_names

__getattr__ = old_names(
    __name__,
    {"Problem": "tuning.kinds.estimation.problem:EstimationProblem", "draw_scenarios": "tuning.problem.scenarios"}
    | dict.fromkeys(("Outcome", "Scenario", "Status"), "tuning.problem.interface"),
)
