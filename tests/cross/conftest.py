"""Tools outside Python that these tests compare with, and an FMU stepped by hand."""

import os
import shutil

import fmpy
import pytest
from fmpy.simulation import instantiate_fmu


@pytest.fixture
def need_tool():
    """Returns ``(what it is for, names) -> path`` of the first of them that exists; without any, skips or fails."""

    def need(purpose, *names):
        found = next(filter(None, map(shutil.which, filter(None, names))), None)
        if found is None:
            missing = f"none of {', '.join(filter(None, names))} is on PATH"
            if os.environ.get("OHMLOOM_REQUIRE_TOOLS"):
                pytest.fail(f"{missing}, and OHMLOOM_REQUIRE_TOOLS is set")
            pytest.skip(f"{missing}: {purpose}")
        return found

    return need


class Master:
    """An FMU of either version in FMPy, for co-simulation; keeps what it logs, `close` frees it and its folder."""

    def __init__(self, file, **start_values):
        self.log = []
        self.folder = fmpy.extract(str(file))
        self.d = fmpy.read_model_description(self.folder)
        self.is_two = self.d.fmiVersion == "2.0"
        self.variables = {v.name: v for v in self.d.modelVariables}
        self.fmu = instantiate_fmu(self.folder, self.d, "CoSimulation", False, False, self._keep)
        self.set(**start_values)
        self.start()

    def _keep(self, *arguments):
        self.log.append(arguments[-1].decode())

    def start(self):
        if self.is_two:
            self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def set(self, **values):
        for name, value in values.items():
            v = self.variables[name]
            getattr(self.fmu, f"set{v.type}")([v.valueReference], [value])

    def get(self, *names):
        return [getattr(self.fmu, f"get{v.type}")([v.valueReference])[0] for v in map(self.variables.get, names)]

    def step(self, k, h=0.032):
        self.fmu.doStep(currentCommunicationPoint=k * h, communicationStepSize=h)

    def close(self):
        self.fmu.freeInstance()
        shutil.rmtree(self.folder)


@pytest.fixture
def master():
    """Returns ``(file, **start_values) -> Master``; all are closed at the end."""
    made = []

    def make(file, **start_values):
        made.append(Master(file, **start_values))
        return made[-1]

    yield make
    for one in made:
        one.close()
