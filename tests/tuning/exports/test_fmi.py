"""An FMU keeps to the standard, and says what it refuses."""

from __future__ import annotations

import math
from contextlib import contextmanager
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from tests.tuning.exports.families import FAMILIES, subject
from tests.tuning.exports.native import needs_compiler
from tuning.exports.export import write_export

fmpy = pytest.importorskip("fmpy")
simulation = pytest.importorskip("fmpy.simulation")

pytestmark = [needs_compiler, pytest.mark.contract]

CASES = {"controller": "damping", "window": "algebraic"}
STEP = 1e-3
ERROR = 3


@pytest.fixture(scope="module", params=[2, 3], ids=["fmi2", "fmi3"])
def version(request):
    return request.param


@pytest.fixture(scope="module")
def files(version, tmp_path_factory, request):
    """The FMUs of one version, each with its checks' results."""
    folder = tmp_path_factory.mktemp("fmus")
    found = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(request.config.rootpath))
        for name, family in CASES.items():
            done = write_export(subject(family), f"fmi{version}", FAMILIES[family][0], folder / name)
            assert done.ok, done.results
            found[name] = done.written[0]
    return found


class Master:
    """An instance, and what it was told; of several of version 2 FMPy tells the last one only.

    Args:
        file: the FMU.
        version: of the standard.
    """

    def __init__(self, file: Path, version: int):
        self.version = version
        self.told: list[tuple[int, str, str]] = []
        self.description = fmpy.read_model_description(str(file))
        self.variables = {variable.name: variable for variable in self.description.modelVariables}
        self.folder = fmpy.extract(str(file))
        self.fmu = simulation.instantiate_fmu(self.folder, self.description, "CoSimulation", logger=self._log)

    def _log(self, *words):
        """Take a message; version 2 names the instance before the status."""
        status, category, message = words[-3:]
        self.told.append((status, category.decode(), message.decode()))

    def begin(self, start=0.0, stop=None):
        if self.version == 2:
            self.fmu.setupExperiment(startTime=start, stopTime=stop)
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(startTime=start, stopTime=stop)
        self.fmu.exitInitializationMode()
        return self

    def get(self, name):
        variable = self.variables[name]
        (value,) = getattr(self.fmu, f"get{variable.type}")([variable.valueReference])
        return value

    def set(self, name, value):
        variable = self.variables[name]
        getattr(self.fmu, f"set{variable.type}")([variable.valueReference], [value])

    def step(self, time, step=STEP):
        return self.fmu.doStep(currentCommunicationPoint=time, communicationStepSize=step)

    def state(self):
        return self.fmu.getFMUState()

    @contextmanager
    def refuses(self, words):
        """See that a call ends with an error, and that the master is told why, once."""
        before = len(self.told)
        with pytest.raises(fmpy.fmi1.FMICallException) as caught:
            yield
        assert caught.value.status == ERROR
        ((status, category, message),) = self.told[before:]
        assert (status, category) == (ERROR, "logStatusError")
        assert words in message


@pytest.fixture
def master(files, version):
    made = []

    def make(name="controller"):
        made.append(Master(files[name], version))
        return made[-1]

    yield make
    for one in made:
        one.fmu.freeInstance()


def test_before_the_first_step_it_answers_as_at_rest(master):
    controller = master()
    parameters = {name: controller.get(name) for name in ("controller.soft", "controller.stiff")}
    middle = np.mean(list(parameters.values()))
    assert controller.get("out.stiffness") == pytest.approx(middle)
    controller.set("controller.stiff", 2.0)
    assert controller.get("out.stiffness") == pytest.approx((2.0 + parameters["controller.soft"]) / 2)
    controller.set("link_position", 0.3)
    assert controller.begin().get("out.stiffness") == pytest.approx((2.0 + parameters["controller.soft"]) / 2)
    assert controller.get("out.held")
    estimator = master("window").begin()
    assert math.isinf(estimator.get("out.stiffness_std"))
    assert math.isinf(estimator.get("out.sides[1].stiffness_std"))
    assert not estimator.get("out.known")
    assert not estimator.told


def test_time_is_where_the_master_is(master, version):
    one = master().begin(start=5.0)
    if version == 2:
        assert "time" not in one.variables
        return
    assert one.get("time") == 5.0
    one.step(5.0)
    assert one.get("time") == pytest.approx(5.001, abs=1e-12)
    assert one.step(5.001)[-1] == pytest.approx(5.002, abs=1e-12)


def test_what_the_model_description_says_of_time(files, version):
    for name, file in files.items():
        description = fmpy.read_model_description(str(file))
        assert description.coSimulation.canHandleVariableCommunicationStepSize is (name != "window")
        assert float(description.defaultExperiment.stepSize) == STEP
        fixed = description.coSimulation.fixedInternalStepSize
        assert (fixed is not None and float(fixed) == STEP) == (version == 3 and name == "window")
        assert "irregular" in (file.parent / "README.md").read_text() or name == "window"
    page = (files["window"].parent / "README.md").read_text()
    assert "Every step must be of 0.001 s: this estimator counts samples" in page
    assert "may be irregular" not in page


def test_outputs_depend_on_no_input_within_a_step(files, version):
    for file in files.values():
        folder = Path(fmpy.extract(str(file)))
        root = ElementTree.parse(folder / "modelDescription.xml").getroot()
        described = fmpy.read_model_description(str(file))
        outputs = {v.name for v in described.modelVariables if v.causality == "output"}
        path = "ModelStructure/Outputs/Unknown" if version == 2 else "ModelStructure/Output"
        found = root.findall(path)
        assert len(found) == len(outputs)
        assert {row.attrib["dependencies"] for row in found} == {""}
        parameters = {v.name for v in described.modelVariables if v.causality == "parameter"}
        first = described.initialUnknowns[0]
        assert {variable.name for variable in first.dependencies} == parameters


@pytest.mark.failure
@pytest.mark.parametrize("step", [2 * STEP, 5 * STEP, 0.5 * STEP])
def test_what_counts_samples_takes_its_own_steps_only(master, step):
    one = master("window").begin()
    with one.refuses(f"got a step of {step:g} s; this estimator counts samples, every step must be of 0.001 s"):
        one.step(0.0, step)
    one.step(0.0)
    with one.refuses("counts samples"):
        one.step(STEP, step)
    one.step(STEP)


def test_a_controller_takes_any_steps_that_follow_one_another(master):
    one = master().begin(stop=0.1)
    for time, step in ((0.0, 0.001), (0.001, 0.0025), (0.0035, 0.02)):
        one.step(time, step)
    with one.refuses("the last one, or initialization, ended at 0.0235"):
        one.step(0.05)
    with one.refuses("ended at 0.0235"):
        one.step(0.0035)
    with one.refuses("beyond the stop time of 0.1"):
        one.step(0.0235, 0.1)
    one.step(0.0235)


@pytest.mark.failure
@pytest.mark.parametrize(
    ("time", "step"),
    [(0.0, -5.0), (0.0, 0.0), (0.0, math.nan), (0.0, math.inf), (math.nan, STEP), (math.inf, STEP)],
)
def test_a_step_that_is_none_is_refused_and_changes_nothing(master, time, step):
    other, one = master().begin(), master().begin()
    with one.refuses("steps are positive and finite"):
        one.step(time, step)
    for k in range(3):
        for each in (one, other):
            each.set("link_position", 0.1 * k)
            each.step(k * STEP)
        assert one.get("out.stiffness") == other.get("out.stiffness")


@pytest.mark.failure
def test_the_order_of_calls_is_kept(master, version):
    one = master()
    with one.refuses("must be in step mode; it is in instantiated"):
        one.step(0.0)
    with one.refuses("must be in step mode"):
        one.fmu.terminate()
    with one.refuses("must be in initialization mode"):
        one.fmu.exitInitializationMode()
    for start, stop, words in ((math.nan, None, "a start time of nan"), (2.0, 1.0, "a stop time of 1")):
        with one.refuses(words):
            one.begin(start, stop)
    one.begin().step(0.0)
    with one.refuses("must be in instantiated; it is in step mode"):
        one.fmu.enterInitializationMode()
    one.fmu.terminate()
    with one.refuses("must be in step mode; it is in terminated"):
        one.step(STEP)
    with one.refuses("the instance is terminated"):
        one.set("link_position", 0.0)
    one.fmu.reset()
    one.begin().step(0.0)


@pytest.mark.failure
def test_what_cannot_be_set_or_read_is_told(master, version):
    one = master().begin()
    real = "Real" if version == 2 else "Float64"
    with one.refuses("value reference 99999: no variable of this type"):
        getattr(one.fmu, f"get{real}")([99999])
    with one.refuses("no variable of this type"):
        one.fmu.getBoolean([one.variables["out.stiffness"].valueReference])
    with one.refuses("cannot be set: it is calculated"):
        one.set("out.stiffness", 1.0)
    for value in (-1.0, math.nan):
        with one.refuses("observer.cutoff"):
            one.set("observer.cutoff", value)
    with one.refuses("SetString: is not offered by this FMU"):
        one.fmu.setString([0], ["text"])
    assert one.get("observer.cutoff") > 0.0


@pytest.mark.failure
def test_a_master_of_another_fmu_is_told(files, version):
    one = Master(files["controller"], version)
    one.description.guid = "{another}"
    with pytest.raises(Exception, match="Failed to instantiate"):
        simulation.instantiate_fmu(one.folder, one.description, "CoSimulation", logger=one._log)
    assert "the master wants {another}" in one.told[-1][-1]
    one.fmu.freeInstance()


@pytest.mark.equivalence
def test_a_state_goes_out_and_comes_back(master):
    one, other = master().begin(), master()
    for k in range(5):
        one.set("link_position", 0.1 * k)
        one.step(k * STEP)
    saved = one.fmu.serializeFMUState(one.state())
    for each in (one, other):
        each.fmu.setFMUState(each.fmu.deserializeFMUState(saved))
        each.step(5 * STEP)
    assert one.get("out.stiffness") == other.get("out.stiffness")
    assert not one.told + other.told


@pytest.mark.failure
def test_a_state_that_is_none_is_refused(master):
    window, one = master("window").begin(), master().begin()
    saved = one.fmu.serializeFMUState(one.state())
    middle = len(saved) // 2
    broken = {
        b"\xff" * len(saved): "is no state of this FMU",
        saved[:middle] + bytes([saved[middle] ^ 1]) + saved[middle + 1 :]: "was changed or is incomplete",
        saved[:-1]: f"a state has {len(saved)}",
        saved + b"0": f"a state has {len(saved)}",
        b"": f"got 0 bytes, a state has {len(saved)}",
        window.fmu.serializeFMUState(window.state()): "bytes, a state has",
    }
    for blob, words in broken.items():
        with one.refuses(words):
            one.fmu.deserializeFMUState(blob)
    with one.refuses("is no state of this FMU"):
        one.fmu.setFMUState(None)
    one.step(0.0)
