"""Compiles the generated C with every compiler found, replays the golden recording, and links for Cortex-M.

python check.py            all of it
python check.py --quick    one compiler only
"""

import json
import math
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from checking import HERE, TOLERANCE, Result, run_checks  # pyright: ignore[reportMissingImports]

MANIFEST = json.loads((HERE / "manifest.json").read_text(encoding="utf-8"))
NAME = MANIFEST["name"]
KINDS = {row["name"]: row["type"] for row in MANIFEST["outputs"]}
SINGLE = f"-D{NAME.upper()}_SINGLE"
STRICT = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Werror"]
DEFAULTS = ["-std=gnu99", "-O2"]
"""What a toolchain compiles with unless it is told otherwise; there gcc fuses products where the processor can."""
FUSED = re.compile(r"\tv?(fma|fms|fnma|fnms|fmla|fmls|fmadd|fmsub|fnmadd|fnmsub)[a-z0-9.]*\s")
SANITIZE = ["-O1", "-g1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
COARSE = 1e-3
"""Deviation at the end of the recording above which single precision is advised against."""
ARM = "arm-none-eabi-gcc"
CORES = {
    "cortex-m4": ["-mcpu=cortex-m4", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16", SINGLE],
    "cortex-m7": ["-mcpu=cortex-m7", "-mfloat-abi=hard", "-mfpu=fpv5-d16"],
}


def run(command: list[str], folder: Path, text: str | None = None) -> subprocess.CompletedProcess[str]:
    """Run a command in a folder, with a text on its standard input."""
    return subprocess.run(command, cwd=folder, input=text, capture_output=True, text=True, check=False)


def build(compiler: str, options: list[str], folder: Path, main: str = "harness.c") -> str:
    """Compile the program with all warnings as errors; return what the compiler objects to."""
    if shutil.which(compiler) is None:
        return f"{compiler} is not installed"
    sources = [str(HERE / f"{NAME}.c"), str(HERE / main)]
    flags = options if options[:2] == DEFAULTS else [*STRICT, *options]
    built = run([compiler, *flags, "-o", "program", *sources, "-lm"], folder)
    return "" if built.returncode == 0 else built.stderr[:2000] or "cannot be compiled"


def replay(name: str, compiler: str, options: list[str], *, is_judged: bool = True) -> Result:
    """Return how far the compiled step lies from the golden recording."""
    if shutil.which(compiler) is None:
        return Result(name, "skipped", f"{compiler} is not installed")
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        problem = build(compiler, options, folder)
        if "libclang_rt" in problem:
            return Result(name, "skipped", "the sanitizers of clang are not installed (Debian: libclang-rt-dev)")
        if problem:
            return Result(name, "failed", problem)
        ran = run(["./program", str(HERE / "golden.csv"), *([f"{TOLERANCE}"] if is_judged else [])], folder)
    if ran.returncode not in {0, 1} or (ran.stderr and ran.returncode):
        return Result(name, "failed", (ran.stderr or ran.stdout)[:2000])
    rows = [line.split() for line in ran.stdout.splitlines()]
    size = next(row[1:] for row in rows if row[0] == "bytes")
    rows = [row for row in rows if row[0] != "bytes"]
    found = {row[0]: float(row[1]) for row in rows}
    final = {row[0]: float(row[2]) for row in rows}
    lost = {row[0]: int(row[3]) for row in rows if row[3] != "0"}
    figures: dict[str, Any] = {
        "deviation": found,
        "final_deviation": {key: value if math.isfinite(value) else None for key, value in final.items()},
        "not_finite": lost,
        "bytes": dict(zip(("instance", "input", "output"), map(int, size), strict=True)),
    }
    if not is_judged:
        differing = {row[0]: int(row[4]) for row in rows if KINDS[_whole(row[0])] != "real" and row[4] != "0"}
        told = _stated({key: value for key, value in found.items() if KINDS[_whole(key)] == "real"}, final)
        told += "".join(f"; {key} is not finite where double precision is, {_samples(lost[key])}" for key in lost)
        told += "".join(f"; {key} differs {_samples(count)}" for key, count in differing.items())
        is_coarse = any(not final[key] <= COARSE for key in found if key not in differing)
        told += "; TOO COARSE at the end: use double precision" if is_coarse else ""
        return Result(name, "passed", told, figures | {"differing": differing})
    worst = max(found, key=lambda key: math.inf if key in lost else found[key])
    far = math.inf if worst in lost else found[worst]
    state = "passed" if ran.returncode == 0 else "failed"
    return Result(name, state, f"largest deviation {far:.2g} ({worst}), allowed {TOLERANCE:g}", figures)


def _stated(found: dict[str, float], final: dict[str, float]) -> str:
    """Return how far the worst of all outputs is off, over the recording and at its end."""
    worst = max(found, key=lambda key: found[key])
    last = max(found, key=lambda key: final[key] if math.isfinite(final[key]) else -1.0)
    return (
        f"stated, not judged: of all outputs {worst} is off the most, by {found[worst]:.2g}; "
        f"at the end {last}, by {final[last]:.2g}"
    )


def _samples(count: int) -> str:
    return f"at {count} of {MANIFEST['golden']['samples']} samples"


def _whole(entry: str) -> str:
    """Return the output that a column is an entry of; sides[0].stiffness is one by itself, torque[0] is not."""
    return entry if entry in KINDS else re.sub(r"(\[\d+\])+$", "", entry)


def double_precision() -> list[Result]:
    """Replay as each compiler builds it."""
    compilers = ["gcc"] if "--quick" in sys.argv and shutil.which("gcc") else ["gcc", "clang"]
    results = [replay(f"{compiler}, double", compiler, ["-O2"]) for compiler in compilers]
    if all(result.state == "skipped" for result in results):
        results.append(Result("compiler", "failed", "no C compiler was found: install gcc or clang"))
    return results


def toolchain_defaults() -> Result:
    """Replay as a toolchain builds it that is told nothing, for this processor with all that it can."""
    native = "-march=native" if _takes("-march=native") else "-O2"
    return replay(f"{_compiler()} by its defaults", _compiler(), [*DEFAULTS, native])


def _takes(option: str) -> bool:
    return run([_compiler(), option, "-E", "-x", "c", "-"], HERE, text="").returncode == 0


def single_precision() -> Result:
    """State the error of single precision."""
    return replay("single precision", _compiler(), ["-O2", SINGLE], is_judged=False)


def sanitizers() -> list[Result]:
    """Replay under the sanitizers of each compiler."""
    return [replay(f"{compiler}, address and undefined", compiler, SANITIZE) for compiler in ("gcc", "clang")]


def step_time() -> Result:
    """State how long a step takes here."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        problem = build(_compiler(), ["-O2"], folder)
        if problem:
            return Result("step time", "skipped", problem)
        ran = run(["./program", str(HERE / "golden.csv"), "time"], folder)
    nanoseconds = float(ran.stdout.split()[1])
    told = f"{nanoseconds:.0f} ns a step on this machine ({_compiler()} -O2, best of 20 replays)"
    return Result("step time", "passed", told, {"nanoseconds": nanoseconds})


def microcontrollers() -> list[Result]:
    """Link for each core and state the size."""
    return [_link(core, options) for core, options in CORES.items()]


def _link(core: str, options: list[str]) -> Result:
    if shutil.which(ARM) is None:
        return Result(
            core, "skipped", f"{ARM} is not installed (Debian: gcc-arm-none-eabi, libnewlib-arm-none-eabi)"
        )
    specs = [
        "--specs=nano.specs",
        "--specs=nosys.specs",
        "-Wl,--gc-sections",
        "-ffunction-sections",
        "-fdata-sections",
    ]
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        problem = build(ARM, ["-O2", "-mthumb", *options, *specs, "-fstack-usage"], folder, "cortex_m.c")
        if problem:
            return Result(core, "failed", problem)
        text, data, bss = map(
            int, run(["arm-none-eabi-size", "program"], folder).stdout.splitlines()[1].split()[:3]
        )
        fused = _fused(options, folder)
        if fused:
            return Result(core, "failed", f"by its defaults {ARM} fuses products and sums: {fused}")
        usage = "".join(path.read_text(encoding="utf-8") for path in folder.glob("*.su"))
    stack = {
        function.rpartition(":")[2].removeprefix(f"{NAME}_"): int(count)
        for function, count in re.findall(r"^(\S+)\t(\d+)", usage, re.MULTILINE)
        if not function.endswith(":main")
    }
    figures = {"flash": text + data, "ram": data + bss, "stack": stack}
    precision = "single" if SINGLE in options else "double"
    deepest = max(stack, key=lambda key: stack[key])
    told = (
        f"links in {precision} precision: {text + data} bytes of flash, {data + bss} of RAM, "
        f"{stack[deepest]} of stack ({deepest})"
    )
    return Result(core, "passed", told, figures)


def _fused(options: list[str], folder: Path) -> str:
    """Return a fused instruction that the compiler makes by its defaults; nothing where it makes none."""
    run([ARM, *DEFAULTS, "-mthumb", *options, "-c", "-o", "defaults.o", str(HERE / f"{NAME}.c")], folder)
    listing = run(["arm-none-eabi-objdump", "-d", "defaults.o"], folder).stdout
    found = FUSED.search(listing)
    return found[0].strip() if found else ""


def _compiler() -> str:
    return "gcc" if shutil.which("gcc") else "clang"


if __name__ == "__main__":
    everything = [double_precision, toolchain_defaults, single_precision, sanitizers, step_time, microcontrollers]
    run_checks([double_precision, toolchain_defaults, single_precision] if "--quick" in sys.argv else everything)
