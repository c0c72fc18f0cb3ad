"""FMUs: size, time of export, error against the closed form, steps per second in a C loop and through FMPy.

Their peer is a minimal Dahlquist model of our own, `dahlquist.c`: one Euler step of dx/dt = -k x in each doStep.
`python benchmarks/fmu.py Dahlquist.fmu` times the Reference FMU of that name (FMI 2.0, linux, not shipped here)
instead, with steps of 0.1 s, each of which is one of its Euler steps.

The model is the paper's HP device, normalised, at 0.8 V from q = 0: (1 - q)^2 = 1 - 1.6 t until q = 0.99.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
import zipfile
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
from fmpy.simulation import instantiate_fmu

from ohmloom.circuits import MemristorCrossbar
from ohmloom.devices import Device
from ohmloom.fmu import export_arena, export_controller, export_crossbar, export_device, export_system
from ohmloom.fmu.build import HEADERS
from ohmloom.neurocontroller import champion

STEPS = 200_000  # through FMPy; 20 times as many in C
LOOP = """#include <stdio.h>
#include <time.h>
#include "fmu.c"
int main(void)
{
    const unsigned int v = FIRST_U, i = FIRST_Y;
    const clock_t begin = clock();
    double out = 0.0;
    int k;
    Instance *m = create(calloc(1, sizeof *m), "loop", MODEL_TOKEN, 1, 0);
    m->s.phase = INITIALIZING;
    leave_initialization(m);
    for (k = 0; k < @steps@; k++) {
        const double x = k % 200 < 100 ? 0.3 : -0.3;
        if (set_values(m, &v, 1, &x) || step(m, 1e-4 * k, 1e-4) || get_values(m, &i, 1, &out))
            return 1;
    }
    destroy(m);
    printf("%.17g\\n", @steps@ / ((double)(clock() - begin) / CLOCKS_PER_SEC));
    return 0;
}
"""

DAHLQUIST_LOOP = """#include <stdio.h>
#include <time.h>
#include <stdlib.h>
#include "fmi2Functions.h"
static void log_nothing(fmi2ComponentEnvironment e, fmi2String name, fmi2Status status, fmi2String kind,
                        fmi2String text, ...)
{
    (void)e, (void)name, (void)status, (void)kind, (void)text;
}
static const fmi2CallbackFunctions host = {log_nothing, calloc, free, NULL, NULL};
int main(void)
{
    const fmi2ValueReference k_ref = @k@, x_ref = @x@;
    const clock_t begin = clock();
    double out = 0.0;
    int k;
    fmi2Component m = fmi2Instantiate("loop", fmi2CoSimulation, "@token@", "", &host, 0, 0);
#if @is_whole@
    if (fmi2SetupExperiment(m, 0, 0.0, 0.0, 0, 0.0) || fmi2EnterInitializationMode(m) || fmi2ExitInitializationMode(m))
        return 1;
#endif
    for (k = 0; k < @steps@; k++) {
        const double x = k % 200 < 100 ? 0.3 : -0.3;
        if (fmi2SetReal(m, &k_ref, 1, &x) || fmi2DoStep(m, @h@ * k, @h@, 1) || fmi2GetReal(m, &x_ref, 1, &out))
            return 1;
    }
    fmi2FreeInstance(m);
    printf("%.17g\\n", @steps@ / ((double)(clock() - begin) / CLOCKS_PER_SEC));
    return 0;
}
"""


def main() -> None:
    """Print the table."""
    device = Device.load("hp_tio2_paper")
    print(f"FMPy {fmpy.__version__}; set, step and get in each step")
    print("FMI   size   export  error, free  error, at the wall  arrival, ME    C loop     FMPy")
    with tempfile.TemporaryDirectory() as folder:
        for fmi in (2, 3):
            file = Path(folder) / f"hp{fmi}.fmu"
            begin = time.perf_counter()
            size = export_device(device, file, fmi=fmi, q0=0.0).size
            export = time.perf_counter() - begin
            free, wall = errors(file)
            c, python = in_c(file, fmi, Path(folder) / f"c{fmi}"), through_fmpy(file)
            print(f"{fmi}.0 {size / 1000:5.1f}kB {export:6.2f}s {free:12.1e} {wall:18.1e} {arrival(file):12.7f}s "
                  f"{c / 1e6:6.2f}M/s {python / 1e3:6.0f}k/s")  # fmt: skip
            if fmi == 2:
                given, place = Path(sys.argv[1]) if len(sys.argv) > 1 else None, Path(folder) / "dahlquist"
                peer = reference(given, place) if given else dahlquist(place)
                name = given.name if given else "our own Dahlquist"
                print(f"    of {name}'s, one Euler step: {peer[0] / 1e6:.2f}M/s, {c / peer[0]:.2f}x in C; "
                      f"{peer[1] / 1e3:.0f}k/s, {python / peer[1]:.2f}x through FMPy")  # fmt: skip
        print(f"exact arrival {(1 - 0.01**2) / 1.6:.7f}s")
        crossbars(Path(folder))
        discrete(Path(folder))


def crossbars(folder: Path) -> None:
    """Export of arrays with wires, and a step of 16 x 16 devices without, as one FMU and as 256."""
    hp = Device.load("hp_tio2_10k")
    rng = np.random.default_rng(1)
    print("crossbar     size   export   step")
    for n in (4, 16, 64):
        array = MemristorCrossbar(devices=hp, s=rng.uniform(0.2, 0.8, (n, n)), r_row=1.0, r_column=1.0)
        begin = time.perf_counter()
        written = export_crossbar(array, folder / f"x{n}.fmu")
        export = time.perf_counter() - begin
        spent = stepped([written.path], "v_row_0", ["i_column_0"], 100 if n < 64 else 2)
        print(f"{n:2} x {n:2} {written.size / 1000:8.1f}kB {export:6.2f}s {1e6 * spent:8.0f}us")
    flat = export_crossbar(MemristorCrossbar(devices=hp, s=np.full((16, 16), 0.5)), folder / "flat.fmu").path
    one = stepped([flat], "v_row_0", [f"i_column_{j}" for j in range(16)], 1000)
    many = stepped([export_device(hp, folder / "hp.fmu").path] * 256, "v", ["i"], 20)
    print(f"16 x 16 without wires, through FMPy: one FMU {1e6 * one:.0f}us a step, 256 device FMUs {1e6 * many:.0f}us, "
          f"{many / one:.0f} times as long")  # fmt: skip


def discrete(folder: Path) -> None:
    """Controller, arena and loop: size, and a timestep through FMPy."""
    network = champion("HET")
    files = {
        "controller": (export_controller(network, folder / "c.fmu"), "light_2", ["action"]),
        "arena": (export_arena("dynamic", folder / "a.fmu"), "", ["x", "y"]),
        "loop": (export_system(network, folder / "l.fmu", task="dynamic"), "", ["x", "y", "heading"]),
    }
    print("discrete      size  timestep")
    for name, (written, given, got) in files.items():
        spent = stepped([written.path], given, got, 2000, 0.032)
        print(f"{name:10} {written.size / 1000:5.1f}kB {1e6 * spent:8.1f}us")


def write_loop(folder: Path, values: dict[str, str]) -> None:
    """A folder with the peer's loop and FMI's headers."""
    folder.mkdir()
    for name in HEADERS[2]:
        (folder / name).write_bytes((Path(fmpy.__file__).with_name("c-code") / name).read_bytes())
    text = DAHLQUIST_LOOP
    for name, value in {**values, "steps": str(20 * STEPS)}.items():
        text = text.replace(f"@{name}@", value)
    (folder / "loop.c").write_text(text)


def reference(path: Path, folder: Path) -> tuple[float, float]:
    """The same of an FMU with the state x and the parameter k, of FMI 2.0."""
    description = fmpy.read_model_description(str(path))
    refs = {v.name: str(v.valueReference) for v in description.modelVariables}
    write_loop(folder, {"k": refs["k"], "x": refs["x"], "h": "0.1", "token": description.guid, "is_whole": "1"})
    fmpy.extract(str(path), str(folder / "fmu"))
    library = f"fmu/binaries/linux64/{description.coSimulation.modelIdentifier}.so"
    subprocess.run(["gcc", "-std=c99", "-O2", "loop.c", library, "-o", "loop"], cwd=folder, check=True)
    c = float(subprocess.run(["./loop"], cwd=folder, check=True, capture_output=True, text=True).stdout)
    return c, 1.0 / stepped([path], "k", ["x"], STEPS, 0.1)


def dahlquist(folder: Path) -> tuple[float, float]:
    """Steps per second of CPU time of the peer: of a loop in C, and of the same calls that FMPy makes."""
    import ctypes

    write_loop(folder, {"k": "1", "x": "0", "h": "1e-4", "token": "", "is_whole": "0"})
    (folder / "dahlquist.c").write_text(Path(__file__).with_name("dahlquist.c").read_text())
    flags = ["gcc", "-std=c99", "-O2", "-ffp-contract=off"]
    # Apart, as an importer and an FMU are: inlined, the loop is nothing but a multiplication.
    subprocess.run([*flags, "dahlquist.c", "loop.c", "-o", "loop"], cwd=folder, check=True)
    subprocess.run([*flags, "-shared", "-fPIC", "dahlquist.c", "-o", "d.so"], cwd=folder, check=True)
    c = float(subprocess.run(["./loop"], cwd=folder, check=True, capture_output=True, text=True).stdout)
    library = ctypes.CDLL(str(folder / "d.so"))
    make, put, get, step = (getattr(library, f"fmi2{name}") for name in ("Instantiate", "SetReal", "GetReal", "DoStep"))
    real, reference = ctypes.c_double, ctypes.c_uint
    make.restype = ctypes.c_void_p
    put.argtypes = get.argtypes = [ctypes.c_void_p, ctypes.POINTER(reference), ctypes.c_size_t, ctypes.POINTER(real)]
    step.argtypes = [ctypes.c_void_p, real, real, ctypes.c_int]
    m = make(None, 1, None, None, None, 0, 0)

    class Through(fmpy.fmi2.FMU2Slave):  # type: ignore[misc]
        """FMPy's own methods on that library."""

        def __init__(self) -> None:
            self.component, self.fmi2SetReal, self.fmi2GetReal, self.fmi2DoStep = m, put, get, step

    one = Through()
    begin = time.process_time()
    for k in range(STEPS):
        one.setReal([1], [0.3 if k % 200 < 100 else -0.3])
        one.doStep(currentCommunicationPoint=1e-4 * k, communicationStepSize=1e-4)
        one.getReal([0])
    return c, STEPS / (time.process_time() - begin)


def stepped(paths: list[Path], given: str, got: list[str], count: int, h: float = 1e-4) -> float:
    """CPU time in s of a step of all FMUs through FMPy: set, step, get."""
    with tempfile.TemporaryDirectory() as folder:
        fmpy.extract(str(paths[0]), folder)
        description = fmpy.read_model_description(folder)
        references = {v.name: v.valueReference for v in description.modelVariables}
        fmus = [instantiate_fmu(folder, description, "CoSimulation") for _ in paths]
        for fmu in fmus:
            fmu.setupExperiment(startTime=0.0)
            fmu.enterInitializationMode()
            fmu.exitInitializationMode()
        into, out = [references[given]] if given else [], [references[name] for name in got]
        is_real = next(v for v in description.modelVariables if v.name == got[0]).type == "Real"
        begin = time.process_time()
        for k in range(count):
            for fmu in fmus:
                if into:
                    fmu.setReal(into, [0.3 if k % 20 < 10 else 0.0])
                fmu.doStep(currentCommunicationPoint=k * h, communicationStepSize=h)
                (fmu.getReal if is_real else fmu.getInteger)(out)
        spent = time.process_time() - begin
        for fmu in fmus:
            fmu.terminate()
            fmu.freeInstance()
    return spent / count


def errors(file: Path) -> tuple[float, float]:
    """Largest error of the charge in co-simulation with 10 ms steps, before t = 0.5 s and in all."""
    run = simulated(file, fmi_type="CoSimulation", output_interval=0.01)
    error = np.abs(run["q"] - np.minimum(1 - np.sqrt(np.maximum(1 - 1.6 * run["time"], 0.0)), 0.99))
    return float(error[run["time"] <= 0.5].max()), float(error.max())


def arrival(file: Path) -> float:
    """When the charge comes to rest in model exchange."""
    run = simulated(file, fmi_type="ModelExchange", output=["q", "der(q)"])
    return float(run["time"][run["der(q)"] == 0.0][0])


def simulated(file: Path, **options: Any) -> Any:
    """Run it by FMPy for 1 s at the tolerance 1e-8."""
    return fmpy.simulate_fmu(str(file), start_values={"v": 0.8}, stop_time=1.0, relative_tolerance=1e-8, **options)


def in_c(file: Path, fmi: int, folder: Path) -> float:
    """Steps per second of CPU time of a loop in C."""
    with zipfile.ZipFile(file) as archive:
        archive.extractall(folder)
    for name in HEADERS[fmi]:
        (folder / "sources" / name).write_bytes((Path(fmpy.__file__).with_name("c-code") / name).read_bytes())
    (folder / "sources" / "loop.c").write_text(LOOP.replace("@steps@", str(20 * STEPS)))
    # -Os, as the export compiles a device.
    words = ["gcc", "-std=c99", "-Os", "-ffp-contract=off", "loop.c", "-o", "loop", "-lm"]
    subprocess.run(words, cwd=folder / "sources", check=True)
    return float(subprocess.run(["./loop"], cwd=folder / "sources", check=True, capture_output=True, text=True).stdout)


def through_fmpy(file: Path) -> float:
    """Steps per second of CPU time of a loop in Python, arrays and references prepared."""
    with tempfile.TemporaryDirectory() as folder:
        fmpy.extract(str(file), folder)
        description = fmpy.read_model_description(folder)
        fmu = instantiate_fmu(folder, description, "CoSimulation")
        references = {v.name: v.valueReference for v in description.modelVariables}
        v, i = [references["v"]], [references["i"]]
        is_two = description.fmiVersion == "2.0"
        if is_two:
            fmu.setupExperiment(startTime=0.0)
        fmu.enterInitializationMode()
        fmu.exitInitializationMode()
        put, get = (fmu.setReal, fmu.getReal) if is_two else (fmu.setFloat64, fmu.getFloat64)
        begin = time.process_time()
        for k in range(STEPS):
            put(v, [0.3 if k % 200 < 100 else -0.3])
            fmu.doStep(currentCommunicationPoint=1e-4 * k, communicationStepSize=1e-4)
            get(i)
        spent = time.process_time() - begin
        fmu.terminate()
        fmu.freeInstance()
    return STEPS / spent


if __name__ == "__main__":
    main()
