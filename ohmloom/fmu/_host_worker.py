"""What runs beside a hosted FMU's native code, in a process that may die; `host.Host` starts it.

It imports nothing of ohmloom, reads one request a line from its input, and writes one answer a line.
"""

from __future__ import annotations

import json
import math
import os
import sys
from typing import Any

Request = dict[str, Any]


def main() -> None:
    """Serve until the input ends; the first argument says what to load."""
    task = json.loads(sys.argv[1])
    # The FMU may print: its words must not get among the answers.
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    try:
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (task["memory"], task["memory"]))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    except ImportError:  # not on Windows
        pass
    instance: Instance | None = None
    for line in sys.stdin:
        logged: list[str] = []
        try:
            if instance is None:
                instance = Instance(task["folder"])
            instance.logged = logged
            answer = instance.serve(json.loads(line))
        except MemoryError:
            answer = {"problem": f"more memory wanted than {task['memory'] // 10**6} MB"}
        except Exception as error:  # noqa: BLE001 - FMPy raises bare exceptions; each is the answer
            text = "; ".join([str(error) or type(error).__name__, *logged[-3:]])
            answer = {"problem": " ".join(text.split()).rstrip(".")[:500]}
        answers.write(json.dumps(answer) + "\n")


class Instance:
    """One co-simulation instance, made once and reset between runs."""

    def __init__(self, folder: str) -> None:
        import fmpy
        from fmpy.simulation import instantiate_fmu

        self.logged: list[str] = []
        self.description = fmpy.read_model_description(folder, validate=False)
        self.variables = {v.name: v for v in self.description.modelVariables}
        self.is_two = self.description.fmiVersion.startswith("2")
        self.fmu = instantiate_fmu(folder, self.description, "CoSimulation", logger=self._log)
        self.is_new = True

    def _log(self, *arguments: Any) -> None:
        *_, status, _, message = arguments
        if status > 1 and message:
            self.logged.append(message.decode(errors="replace"))

    def serve(self, request: Request) -> Request:
        """Do what is asked, in this order: start, set, step, get."""
        if "describe" in request:
            return self.describe()
        if "start" in request:
            self.start(request["start"], request["time"])
        self.put(request.get("set", {}))
        if "step" in request:
            begin, length = request["step"]
            self.fmu.doStep(currentCommunicationPoint=begin, communicationStepSize=length)
        return {"values": {name: self.value(name) for name in request.get("get", ())}}

    def start(self, values: Request, time: float) -> None:
        if not self.is_new:
            self.fmu.reset()
        self.is_new = False
        if self.is_two:
            self.fmu.setupExperiment(startTime=time)
            self.put(values)
            self.fmu.enterInitializationMode()
        else:
            self.put(values)
            self.fmu.enterInitializationMode(startTime=time)
        self.fmu.exitInitializationMode()

    def put(self, values: Request) -> None:
        for name, x in values.items():
            v = self.variables[name]
            kind = v.type if v.type != "Enumeration" else "Integer" if self.is_two else "Int64"
            if v.shape:
                getattr(self.fmu, f"set{kind}")([v.valueReference], list(x))
                continue
            value = x if kind in ("String", "Binary") else bool(x) if kind == "Boolean" else x
            if kind not in ("Real", "Float64", "Float32", "Boolean", "String", "Binary"):
                value = int(x)
            getattr(self.fmu, f"set{kind}")([v.valueReference], [value])

    def value(self, name: str) -> Any:
        v = self.variables[name]
        kind = v.type if v.type != "Enumeration" else "Integer" if self.is_two else "Int64"
        if v.shape:
            return getattr(self.fmu, f"get{kind}")([v.valueReference], math.prod(v.shape))
        x = getattr(self.fmu, f"get{kind}")([v.valueReference])[0]
        return bool(x) if kind == "Boolean" else x

    def describe(self) -> Request:
        d = self.description
        experiment = d.defaultExperiment
        # None where the description does not say: then on every input.
        needs = {
            unknown.variable.name: [v.name for v in unknown.dependencies] if unknown.dependencies is not None else None
            for unknown in d.outputs
        }
        keys = ("name", "causality", "variability", "initial", "min", "max", "type", "start")
        return {
            "variables": [
                {key: getattr(v, key) for key in keys} | {"shape": list(v.shape or ())} for v in d.modelVariables
            ],
            "dependencies": needs,
            "step_size": float(experiment.stepSize) if experiment and experiment.stepSize else None,
            "stop_time": float(experiment.stopTime) if experiment and experiment.stopTime else None,
        }


if __name__ == "__main__":
    main()
