"""Every kernel of the bench, in the order of its rows."""

from __future__ import annotations

from tuning.bench import antagonistic, damping, joints, serial
from tuning.bench.workload import Kernel

KERNELS: dict[str, Kernel] = {
    kernel.name: kernel for kernel in (*joints.KERNELS, *serial.KERNELS, *antagonistic.KERNELS, *damping.KERNELS)
}
