"""Emitted Verilog-A: its assignments, which are C but for a few names, equal the law; OpenVAF compiles the modules."""

import ctypes
import os
import re
import subprocess

import numpy as np
import pytest

from ohmloom.devices import LAWS, CardValue, Device

COMPILE = """
import sys, openvaf_py
for path in sys.argv[1:]:
    (module,) = openvaf_py.compile_va(path)
    print(module.name, *(node["name"] for node in module.get_dae_system()["nodes"][:3]))
"""
STATES = [0.0, 0.3, 0.95, 1.0]
VOLTAGES = [-0.5, -0.02, 0.0, 1e-3, 0.45]
# The last bits of exp, sinh and pow, magnified by sums; a vanishing window is exact to its size elsewhere.
RELATIVE = 1e-11


def default_device(law):
    entries = tuple(CardValue(value=parameter.default, source="default") for parameter in law.parameters)
    return Device(name=f"law_{law.name}", law=law.name, source="defaults", values=entries)


def as_c(text):
    """A C function ``void module(double state, double voltage, double *out)`` of the module's own lines."""
    body = text.split("analog begin")[1].split("// An outward rate")[0]
    body = body.replace("V(x)", "state").replace("V(p, n)", "voltage")
    names = ", ".join(re.findall(r"^\s+([a-z]\w*) = ", body, re.M))
    given = re.findall(r"parameter real (\w+) = (\S+) from", text)
    parameters = "".join(f"    const double {name} = {value};\n" for name, value in given)
    return (
        "#include <math.h>\n#define ln log\n#define abs fabs\n#define min fmin\n#define max fmax\n"
        "void module(double state, double voltage, double *out)\n{\n"
        f"{parameters}    double {names};\n{body}\n    out[0] = i; out[1] = rate; out[2] = q;\n}}\n"
    )


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_assignments_equal_the_law(law, need_tool, tmp_path):
    compiler = need_tool("emitted Verilog-A is not evaluated here", os.environ.get("CC", ""), "gcc", "clang")
    device = default_device(law)
    source, library = tmp_path / "module.c", tmp_path / "module.so"
    source.write_text(as_c(device.emit("verilog-a")))
    done = subprocess.run([compiler, "-shared", "-fPIC", str(source), "-o", str(library), "-lm"], capture_output=True,
                          text=True, check=False)  # fmt: skip
    assert done.returncode == 0, done.stderr
    module = ctypes.CDLL(str(library)).module
    module.argtypes = [ctypes.c_double, ctypes.c_double, ctypes.POINTER(ctypes.c_double)]
    p = tuple(device.parameters.values())
    for v in VOLTAGES:
        got = np.empty((len(STATES), 3))
        wanted = np.empty((len(STATES), 3))
        for k, s in enumerate(STATES):
            module(s, v, got[k].ctypes.data_as(ctypes.POINTER(ctypes.c_double)))
            i = law.conductance(s, v, p) * v
            wanted[k] = i, law.charge_rate(s, v, i, p) / law.charge_scale(p), s * law.charge_scale(p)
        largest = np.abs(wanted).max(axis=0)
        np.testing.assert_array_less(np.abs(got - wanted), RELATIVE * np.abs(wanted) + 1e-14 * largest + 1e-300)


def test_openvaf_compiles_every_law_and_card(tmp_path):
    python = os.environ.get("OHMLOOM_OPENVAF_PYTHON", "")
    if not python:
        missing = "OHMLOOM_OPENVAF_PYTHON names no Python with openvaf-py, which is not among our dependencies"
        if os.environ.get("OHMLOOM_REQUIRE_TOOLS"):
            pytest.fail(f"{missing}, and OHMLOOM_REQUIRE_TOOLS is set")
        pytest.skip(f"{missing}: emitted Verilog-A is not compiled here")
    devices = [*map(default_device, LAWS.values()), *map(Device.load, Device.names())]
    paths = []
    for device in devices:
        paths.append(tmp_path / f"{device.name}.va")
        paths[-1].write_text(device.emit("verilog-a"))
    done = subprocess.run([python, "-c", COMPILE, *map(str, paths)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert [line.split() for line in done.stdout.splitlines()] == [[device.name, "p", "n", "x"] for device in devices]
