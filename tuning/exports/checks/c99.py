"""Compiles the generated C with every compiler found, replays the golden recording, and links for Cortex-M.

python check.py            all of it
python check.py --quick    one compiler only
"""

import json
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

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
    found = {row[0]: float(row[1]) for row in rows if row[0] != "bytes"}
    final = {row[0]: float(row[2]) for row in rows if row[0] != "bytes"}
    size = next(row[1:] for row in rows if row[0] == "bytes")
    worst = max(found, key=lambda key: found[key])
    figures = {
        "deviation": found,
        "final_deviation": final,
        "bytes": dict(zip(("instance", "input", "output"), map(int, size), strict=True)),
    }
    if not is_judged:
        reals = {key: value for key, value in found.items() if KINDS[_whole(key)] == "real"}
        others = ", ".join(key for key in found if key not in reals and found[key])
        worst = "stiffness" if "stiffness" in reals else max(reals, key=lambda key: reals[key])
        shown = f"{worst} {reals[worst]:.2g}" + (f", and {others} differs," if others else "")
        at_end = _final({key: final[key] for key in reals})
        told = f"stated, not judged: {shown} off at worst, {at_end:.2g} at the end"
        told += "; TOO COARSE: use double precision" if at_end > COARSE else ""
        return Result(name, "passed", told, figures)
    state = "passed" if ran.returncode == 0 else "failed"
    return Result(name, state, f"largest deviation {found[worst]:.2g} ({worst}), allowed {TOLERANCE:g}", figures)


def _whole(entry: str) -> str:
    """Return the output that a column is an entry of; sides[0].stiffness is one by itself, torque[0] is not."""
    return entry if entry in KINDS else re.sub(r"(\[\d+\])+$", "", entry)


def _final(final: dict[str, float]) -> float:
    key = "stiffness" if "stiffness" in final else max(final, key=lambda k: final[k])
    return final[key]


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
