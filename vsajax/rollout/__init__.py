"""Running things over time and over lanes, and what a small change of the numbers does to a loop."""

from vsajax.rollout import sensitivity
from vsajax.rollout.loops import LANES_PER_CHUNK, divisor_near, map_lanes, repeat, scan

__all__ = ["LANES_PER_CHUNK", "divisor_near", "map_lanes", "repeat", "scan", "sensitivity"]
