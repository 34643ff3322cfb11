"""Timings: the lab's kernels against hand-written C and against what the processor can do."""
