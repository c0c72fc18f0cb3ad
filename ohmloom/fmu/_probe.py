"""What runs beside an FMU's native code, in a process that may die; `_process.run_probe` starts it.

It imports nothing of ohmloom, so that a process starts at once.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

Question = dict[str, Any]
Answer = dict[str, Any]
SHORT = 20  # steps of a short simulation


def main() -> None:
    """Answer the question in the file that the first argument names."""
    question = json.loads(Path(sys.argv[1]).read_text())
    try:
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (question["memory"], question["memory"]))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    except ImportError:  # not on Windows
        pass
    logged: list[str] = []
    try:
        answer = PROBES[question["what"]](question, logged)
    except MemoryError:
        answer = {"problem": f"more memory wanted than {question['memory'] // 10**6} MB"}
    except Exception as error:  # noqa: BLE001 - clients raise bare exceptions; each is the answer
        text = str(error) or type(error).__name__
        answer = {
            "problem": " ".join(f"{text}{': ' if logged else ''}{'; '.join(logged[-3:])}".split()).rstrip(".")[:500]
        }
    Path(question["answer"]).write_text(json.dumps(answer))


def _description(question: Question) -> Any:
    import fmpy

    return fmpy.read_model_description(question["folder"], validate=False)


def _logger(logged: list[str]) -> Callable[..., None]:
    """A log callback of FMPy's for either version; status and message stand at the same places from the end."""

    def log(*arguments: Any) -> None:
        *_, status, _, message = arguments
        if status > 1 and message:
            logged.append(message.decode(errors="replace"))

    return log


def validate(question: Question, logged: list[str]) -> Answer:
    """FMPy's problems with the description."""
    from fmpy.validation import validate_fmu

    return {"problems": validate_fmu(question["file"])}


def describe(question: Question, logged: list[str]) -> Answer:
    """What `run` and `check` need of the description."""
    d = _description(question)
    experiment = d.defaultExperiment
    return {
        "variables": [
            {key: getattr(v, key) for key in ("name", "causality", "initial", "min", "max", "type")}
            | {"shape": list(v.shape or ())}
            for v in d.modelVariables
        ],
        "step_size": float(experiment.stepSize) if experiment and experiment.stepSize else None,
        "stop_time": float(experiment.stopTime) if experiment and experiment.stopTime else None,
        "has_state": bool(
            d.coSimulation and d.coSimulation.canGetAndSetFMUstate and d.coSimulation.canSerializeFMUstate
        ),
    }


def symbols(question: Question, logged: list[str]) -> Answer:
    """Load the library, and look for the functions in `names`."""
    import ctypes

    library = ctypes.CDLL(question["library"])
    return {"missing": [name for name in question["names"] if not hasattr(library, name)]}


def simulate(question: Question, logged: list[str]) -> Answer:
    """Run it by FMPy; all columns as lists."""
    import fmpy
    import numpy as np

    given, signals = question.get("inputs"), None
    if given:
        signals = np.array(list(zip(*given.values(), strict=True)), dtype=[(name, float) for name in given])
    names = ("stop_time", "step_size", "output_interval", "start_values")
    result = fmpy.simulate_fmu(
        question["folder"], validate=False, fmi_type=question["interface"], input=signals,
        relative_tolerance=question.get("tolerance"), output=question.get("outputs"), logger=_logger(logged),
        **{name: question.get(name) for name in names},
    )  # fmt: skip
    columns = {}
    for name in result.dtype.names:
        for index in np.ndindex(result[name].shape[1:]):
            columns[_element(name, index)] = result[name][(slice(None), *index)].tolist()
    return {"values": columns}


def _element(name: str, index: tuple[int, ...]) -> str:
    """Name of an element of an array, or of the variable itself."""
    return f"{name}[{','.join(map(str, index))}]" if index else name


def _elements(variable: Any, values: Any) -> Answer:
    """What a function has got of a variable, by element."""
    import numpy as np

    indices = np.ndindex(tuple(variable.shape or ()))
    return {_element(variable.name, i): float(x) for i, x in zip(indices, values, strict=True)}


def _size(variable: Any) -> int:
    import math

    return math.prod(variable.shape or ())


def _got(fmu: Any, variable: Any) -> Any:
    """Values of a variable in FMPy, one or those of an array."""
    get = getattr(fmu, f"get{variable.type}")
    return get([variable.valueReference], _size(variable)) if variable.shape else get([variable.valueReference])


def state(question: Question, logged: list[str]) -> Answer:
    """Save in the middle, go on; restore in a second instance, go on: the same bits."""
    description = _description(question)
    outputs = _outputs(description)
    h = question["step_size"]
    first, second = (_prepared(question, description, logged) for _ in range(2))
    is_two = description.fmiVersion.startswith("2")

    def go_on(fmu: Any, begin: int) -> list[float]:
        for k in range(begin, begin + SHORT):
            fmu.doStep(currentCommunicationPoint=k * h, communicationStepSize=h)
        return [float(x) for v in outputs for x in _got(fmu, v)]

    go_on(first, 0)
    if is_two:
        saved = first.getFMUstate()
        data = first.serializeFMUstate(saved)
        first.freeFMUstate(saved)
    else:
        saved = first.getFMUState()
        data = first.serializeFMUState(saved)
        first.freeFMUState(saved)
    wanted = go_on(first, SHORT)
    if is_two:
        restored = second.deSerializeFMUstate(data)
        second.setFMUstate(restored)
        second.freeFMUstate(restored)
    else:
        restored = second.deserializeFMUState(data)
        second.setFMUState(restored)
        second.freeFMUState(restored)
    got = go_on(second, SHORT)
    for fmu in (first, second):
        fmu.terminate()
        fmu.freeInstance()
    # As bits: a NaN equals itself, and a signed zero not the other.
    is_equal = [x.hex() for x in wanted] == [x.hex() for x in got]
    return {"is_equal": is_equal, "bytes": len(data)}


def _prepared(question: Question, description: Any, logged: list[str]) -> Any:
    """A co-simulation instance of FMPy's, initialized with the start values."""
    import fmpy
    from fmpy.simulation import apply_start_values

    fmu = fmpy.simulation.instantiate_fmu(question["folder"], description, "CoSimulation", logger=_logger(logged))
    if description.fmiVersion.startswith("2"):
        fmu.setupExperiment(startTime=0.0)
        apply_start_values(fmu, description, dict(question["start_values"]))
        fmu.enterInitializationMode()
    else:
        apply_start_values(fmu, description, dict(question["start_values"]))
        fmu.enterInitializationMode(startTime=0.0)
    fmu.exitInitializationMode()
    return fmu


TYPES = ("Real", "Integer", "Boolean", "Float64", "Int32")  # of variables, in both versions, that the probes know


def _outputs(description: Any) -> list[Any]:
    return [v for v in description.modelVariables if v.causality == "output" and v.type in TYPES]


def _given(question: Question, description: Any) -> list[tuple[Any, Any]]:
    """The variables of the start values, each with its value as its type has it."""
    by_name = {v.name: v for v in description.modelVariables}
    return [(by_name[name], _as_type(by_name[name].type, x)) for name, x in question["start_values"].items()]


def _as_type(type_: str, x: Any) -> Any:
    if isinstance(x, list):
        return [_as_type(type_, each) for each in x]
    return bool(x) if type_ == "Boolean" else int(x) if type_ in ("Integer", "Int32") else float(x)


def fmuloader(question: Question, logged: list[str]) -> Answer:
    """The values of the outputs after the same steps in fmuloader."""
    import ctypes

    description = _description(question)
    identifier = description.coSimulation.modelIdentifier
    if description.fmiVersion.startswith("2"):
        from fmuloader.fmi2 import Fmi2Slave, Fmi2Type

        slave = Fmi2Slave(question["folder"], model_identifier=identifier)
        slave.instantiate("probe", Fmi2Type.CO_SIMULATION, guid=description.guid)
        slave.setup_experiment(start_time=0.0)
    else:
        from fmuloader.fmi3 import Fmi3Slave

        slave = Fmi3Slave(question["folder"], model_identifier=identifier)
        slave.instantiate_co_simulation("probe", instantiation_token=description.guid)
    for variable, value in _given(question, description):
        many = value if isinstance(value, list) else [value]
        getattr(slave, f"set_{variable.type.lower()}")([variable.valueReference], many)
    slave.enter_initialization_mode()
    slave.exit_initialization_mode()
    for k in range(SHORT):
        slave.do_step(k * question["step_size"], question["step_size"])
    values: Answer = {}
    for v in _outputs(description):
        if not v.shape:
            got: Any = getattr(slave, f"get_{v.type.lower()}")([v.valueReference])
        else:
            # Its own getter makes room for one value a reference.
            got = (ctypes.c_double * _size(v))()
            if slave._fmi3GetFloat64(slave._instance, slave._vr_array([v.valueReference]), 1, got, _size(v)):
                raise RuntimeError(f"fmi3GetFloat64 failed for {v.name}")
        values |= _elements(v, got)
    slave.terminate()
    slave.free_instance()
    return {"values": values}


def libcosimpy(question: Question, logged: list[str]) -> Answer:
    """The values of the outputs after the same steps in libcosim."""
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    description = _description(question)
    execution = CosimExecution.from_step_size(round(question["step_size"] * 1e9))  # ns
    slave = execution.add_local_slave(CosimLocalSlave(question["file"], "probe"))
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    for variable, value in _given(question, description):
        getattr(execution, f"{variable.type.lower()}_initial_value")(slave, variable.valueReference, value)
    if not execution.step(SHORT):
        raise RuntimeError("libcosim could not take a step")
    values = {
        v.name: float(getattr(observer, f"last_{v.type.lower()}_values")(slave, [v.valueReference])[0])
        for v in _outputs(description)
    }
    return {"values": values}


def pathsim(question: Question, logged: list[str]) -> Answer:
    """The values of the outputs at the same time in PathSim, by model exchange."""
    from pathsim import Connection, Simulation
    from pathsim.blocks import Constant
    from pathsim.solvers import RKDP54
    from pathsim_fmi import ModelExchangeFMU

    # PathSim's inputs are wires; one that ends nowhere is 0, whatever the FMU's start value.
    description, given = _description(question), question["start_values"]
    block = ModelExchangeFMU(question["file"], start_values=dict(given), tolerance=1e-10)
    inputs = [v for v in description.modelVariables if v.causality == "input"]
    held = [Constant(float(given.get(v.name, v.start))) for v in inputs]
    wires = [Connection(source, block[k]) for k, source in enumerate(held)]
    # Its first step is never shortened, and may be too long for a fast circuit.
    simulation = Simulation([block, *held], wires, dt=question["step_size"] / 100.0, log=False, Solver=RKDP54,
                            tolerance_lte_rel=1e-10, tolerance_lte_abs=1e-12)  # fmt: skip
    simulation.run(SHORT * question["step_size"])
    outputs = [v for v in _outputs(description) if v.type in ("Real", "Float64")]
    values = block.outputs.to_array().tolist()
    return {"values": {v.name: value for v, value in zip(outputs, values, strict=True)}}


def system(question: Question, logged: list[str]) -> Answer:
    """Outputs of a system that are not finite in FMPy."""
    import numpy as np
    from fmpy.ssp.simulation import simulate_ssp

    h = question["step_size"]
    found = simulate_ssp(question["file"], stop_time=(SHORT - 0.5) * h, step_size=h)
    return {"wrong": [name for name in found.dtype.names if not np.isfinite(found[name]).all()]}


PROBES: dict[str, Callable[[Question, list[str]], Answer]] = {
    "description": describe,
    "validation": validate,
    "symbols": symbols,
    "simulation": simulate,
    "state round trip": state,
    "fmuloader": fmuloader,
    "libcosimpy": libcosimpy,
    "pathsim": pathsim,
    "system": system,
}

if __name__ == "__main__":
    main()
