"""The Python on an FMU's page: written there when the FMU is exported, and run by its check."""

import json

_GOLDEN = """\
# FMI writes all indices into one pair of brackets.
header = open("golden.csv", encoding="utf-8").readline().strip()
names = [name.replace("][", ",") for name in header.split(",")]
golden = np.loadtxt("golden.csv", delimiter=",", skiprows=1, ndmin=1, dtype=[(name, float) for name in names])
outputs = [name for name in names if name.startswith("out.")]
inputs = [name for name in names if name not in {{"time", "dt", *outputs}}]
"""

_SIMULATED = (
    """\
import numpy as np
from fmpy import simulate_fmu

"""
    + _GOLDEN
    + """
# FMPy steps by the output interval, which it chooses itself where none is given.
result = simulate_fmu(
    {fmu},
    start_time=golden["time"][0],
    stop_time=golden["time"][-1] + {step},
    step_size={step},
    output_interval={step},
    input=golden[["time", *inputs]],
    output=outputs,
)
answers = result[1:]  # answers["out..."][k] is the answer to the sample golden[k]
"""
)

_STEPPED = (
    """\
import numpy as np
from fmpy import extract, read_model_description
from fmpy.simulation import instantiate_fmu

"""
    + _GOLDEN
    + """
# Sample by sample, as they were taken: simulate_fmu takes equal steps and interpolates its input.
description = read_model_description({fmu})
variables = {{variable.name: variable for variable in description.modelVariables}}
fmu = instantiate_fmu(extract({fmu}), description, "CoSimulation")
{begin}
fmu.exitInitializationMode()
steps = np.append(np.diff(golden["time"]), {last})
answers = {{name: [] for name in outputs}}  # answers["out..."][k] is the answer to the sample golden[k]
for sample, step in zip(golden, steps):
    fmu.set{real}([variables[name].valueReference for name in inputs], [sample[name] for name in inputs])
    fmu.doStep(currentCommunicationPoint=sample["time"], communicationStepSize=step)
    for name in outputs:
        get = getattr(fmu, "get" + variables[name].type)
        answers[name] += get([variables[name].valueReference])
fmu.terminate()
fmu.freeInstance()
"""
)


def example(fmu: str, version: int, step: float | None, last: float) -> str:
    """Return Python that runs an FMU over golden.csv and leaves its answers in `answers`.

    Args:
        fmu: the file's name.
        version: of the standard, 2 or 3.
        step: of the recording [s] where `simulate_fmu` can replay it, else None.
        last: step to take from the last sample [s].
    """
    if step is not None:
        return _SIMULATED.format(fmu=json.dumps(fmu), step=float(step))
    begins = {
        2: 'fmu.setupExperiment(startTime=golden["time"][0])\nfmu.enterInitializationMode()',
        3: 'fmu.enterInitializationMode(startTime=golden["time"][0])',
    }
    real = {2: "Real", 3: "Float64"}
    return _STEPPED.format(fmu=json.dumps(fmu), begin=begins[version], real=real[version], last=float(last))
