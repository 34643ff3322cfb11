"""What is simulated, answered and scored: the one floor that knows plants and what estimates or controls them."""

from vsajax.experiments import antagonistic_damping, arm, damping, estimated_damping, estimation

__all__ = ["antagonistic_damping", "arm", "damping", "estimated_damping", "estimation"]
