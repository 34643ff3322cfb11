"""Validates the FMU and runs it over the golden recording with FMPy."""

import contextlib
import json
import shutil
import sys
from typing import Any

from checking import HERE, Result, compare, read_golden, run_checks  # pyright: ignore[reportMissingImports]
from fmi_example import example  # pyright: ignore[reportMissingImports]

MANIFEST = json.loads((HERE / "manifest.json").read_text(encoding="utf-8"))
FMU = str(HERE / MANIFEST["files"][0])


def validation() -> Result:
    """Validate the model description."""
    from fmpy.validation import validate_fmu

    problems = validate_fmu(FMU)
    return Result("validation", "failed" if problems else "passed", "; ".join(problems) or "FMPy finds no problem")


def replay() -> Result:
    """Step the FMU from sample to sample, as they were taken, and compare every answer."""
    import fmpy
    from fmpy.fmi2 import FMU2Slave
    from fmpy.fmi3 import FMU3Slave

    description: Any = fmpy.read_model_description(FMU)
    folder = fmpy.extract(FMU)
    is_third = description.fmiVersion.startswith("3")
    # The standard has one pair of brackets for all indices.
    by_name = {variable.name.replace(",", "]["): variable for variable in description.modelVariables}
    golden = read_golden()
    signals = [name for name in golden.inputs if name != "dt"]
    inputs = [by_name[name].valueReference for name in signals]
    types = {name: by_name[f"out.{name}"].type for name in golden.outputs}
    booleans = [name for name, kind in types.items() if kind == "Boolean"]
    wholes = [name for name, kind in types.items() if kind in {"Integer", "Int32"}]
    reals = [name for name in types if name not in {*booleans, *wholes}]
    references = {name: by_name[f"out.{name}"].valueReference for name in golden.outputs}
    answers: dict[str, list[float]] = {name: [] for name in golden.outputs}
    kind: Any = FMU3Slave if is_third else FMU2Slave
    fmu = kind(
        guid=description.guid,
        unzipDirectory=folder,
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="check",
    )
    try:
        fmu.instantiate()
        if is_third:
            fmu.enterInitializationMode(startTime=golden.time[0])
        else:
            fmu.setupExperiment(startTime=golden.time[0])
            fmu.enterInitializationMode()
        fmu.exitInitializationMode()
        set_real, get_real = (fmu.setFloat64, fmu.getFloat64) if is_third else (fmu.setReal, fmu.getReal)
        get_whole = fmu.getInt32 if is_third else fmu.getInteger
        steps = [b - a for a, b in zip(golden.time, golden.time[1:], strict=False)]
        for k, (time, step) in enumerate(zip(golden.time, [*steps, MANIFEST["fmi"]["last"]], strict=True)):
            set_real(inputs, [golden.inputs[name][k] for name in signals])
            fmu.doStep(currentCommunicationPoint=time, communicationStepSize=step)
            for name, value in zip(reals, get_real([references[n] for n in reals]), strict=True):
                answers[name].append(value)
            for names, get in ((booleans, fmu.getBoolean), (wholes, get_whole)):
                for name, value in zip(names, get([references[n] for n in names]) if names else (), strict=True):
                    answers[name].append(float(value))
        fmu.terminate()
    finally:
        fmu.freeInstance()
        shutil.rmtree(folder, ignore_errors=True)
    return compare("replay", "stepped by FMPy", answers, golden.outputs)


def simulation() -> Result:
    """Run the Python of README.md as it stands there, and compare every answer."""
    about = MANIFEST["fmi"]
    code = example(MANIFEST["files"][0], about["version"], about["step"], about["last"])
    if f"```python\n{code}```\n" not in (HERE / "README.md").read_text(encoding="utf-8"):
        return Result("simulation", "failed", "README.md lacks the Python that was exported with this FMU")
    found: dict[str, Any] = {}
    with contextlib.chdir(HERE):
        exec(code, found)
    golden = read_golden()
    names = {name: f"out.{name}".replace("][", ",") for name in golden.outputs}
    answers = {name: [float(value) for value in found["answers"][field]] for name, field in names.items()}
    return compare("simulation", "the Python of README.md", answers, golden.outputs)


def parameters() -> Result:
    """See that every parameter is tunable, with the default of the manifest."""
    import fmpy

    variables: dict[str, Any] = {
        v.name: v for v in fmpy.read_model_description(FMU).modelVariables if v.causality == "parameter"
    }
    wrong = [
        row["name"]
        for row in MANIFEST["parameters"]
        if not isinstance(row["default"], list)
        and (
            float(variables[row["name"]].start) != row["default"]
            or variables[row["name"]].variability != "tunable"
        )
    ]
    told = f"{len(variables)} tunable, with the defaults of the manifest"
    return Result("parameters", "failed" if wrong else "passed", ", ".join(wrong) or told)


if __name__ == "__main__":
    everything = [validation, parameters, replay, simulation]
    run_checks([validation, replay] if "--quick" in sys.argv else everything)
