"""Emitted C, compiled here, against the law in Python: every law of the table, over states, voltages, parameters."""

import ctypes
import os
import subprocess
import zlib

import numpy as np
import pytest

from ohmloom.devices import LAWS, CardValue, Device
from ohmloom.devices.laws._law import problems

STATES = np.array([0.0, 1e-9, 1e-3, 0.2, 0.5, 0.77, 0.999, 1.0])
VOLTAGES = np.array([-1.0, -0.4, -0.05, -1e-6, 0.0, 1e-4, 0.03, 0.3, 0.8])
CARDS = 20
# Python's and C's exp, sinh and pow differ in the last bit, which sums of a few terms make ten times larger.
RELATIVE = 1e-12
# A window that vanishes at a wall, 1 - pow(...), is exact there to what it is elsewhere.
CANCELLED = 4e-15
# Largest voltage, and decades by which parameters differ from their defaults. Outside its range of validity Pickett's
# iteration does not settle, and magnifies a last bit at will.
REACH = {"pickett": (0.5, 0.05)}
USUAL_REACH = (2.0, 1.0)
NUMBER, ARRAY = ctypes.c_double, ctypes.POINTER(ctypes.c_double)
ARGUMENTS = {"conductance": 2, "current": 2, "charge_rate": 3, "charge_scale": 0, "state_rate": 2}


def device_of(law, values, name="sample"):
    entries = tuple(CardValue(value=float(value), source="test") for value in values)
    return Device(name=name, law=law.name, source="test", values=entries)


def random_parameters(law, decades, rng):
    """Values within their bounds, that many decades, or tenths of the range, from the default at most."""
    while True:
        values = []
        for parameter in law.parameters:
            if parameter.scale == "log":
                value = parameter.default * 10.0 ** rng.uniform(-decades, decades)
            else:
                value = parameter.default + 0.1 * (parameter.upper - parameter.lower) * rng.uniform(-decades, decades)
            values.append(min(max(value, parameter.lower), parameter.upper))
        if not problems(law, values):
            return tuple(values)


def compiled(compiler, folder, name, text):
    source, library = folder / f"{name}.c", folder / f"{name}.so"
    source.write_text(text)
    flags = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-pedantic", "-shared", "-fPIC"]
    done = subprocess.run([compiler, *flags, str(source), "-o", str(library), "-lm"], capture_output=True, text=True,
                          check=False)  # fmt: skip
    assert done.returncode == 0, done.stderr
    return ctypes.CDLL(str(library))


@pytest.fixture
def library_of(need_tool, tmp_path):
    compiler = need_tool("emitted C is not compared here", os.environ.get("CC", ""), "gcc", "clang")

    def load(device):
        loaded = compiled(compiler, tmp_path, device.name, device.emit("c"))
        functions = {}
        for name, count in ARGUMENTS.items():
            functions[name] = getattr(loaded, f"{device.name}_{name}")
            functions[name].argtypes, functions[name].restype = [NUMBER] * count + [ARRAY], NUMBER
        values = (NUMBER * len(device.values)).in_dll(loaded, f"{device.name}_parameters")
        return functions, values

    return load


def evaluate(law, s, v, p):
    g = law.conductance(s, v, p) + 0.0 * s
    charge_rate = law.charge_rate(s, v, g * v, p) + 0.0 * s
    charge_scale = np.broadcast_to(law.charge_scale(p), s.shape)
    rate = charge_rate / charge_scale
    stopped = ((s == 1.0) & (rate > 0)) | ((s == 0.0) & (rate < 0))
    return {
        "conductance": g,
        "current": g * v,
        "charge_rate": charge_rate,
        "charge_scale": charge_scale,
        "state_rate": np.where(stopped, 0.0, rate),
    }


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_c_equals_the_law(law, library_of):
    rng = np.random.default_rng(zlib.crc32(law.name.encode()))
    functions, values = library_of(device_of(law, [parameter.default for parameter in law.parameters]))
    assert list(values) == [parameter.default for parameter in law.parameters]
    largest_voltage, decades = REACH.get(law.name, USUAL_REACH)
    s, v = (axis.ravel() for axis in np.meshgrid(STATES, VOLTAGES * largest_voltage))
    for _ in range(CARDS):
        p = random_parameters(law, decades, rng)
        array = (NUMBER * len(p))(*p)
        expected = evaluate(law, s, v, p)
        for name, wanted in expected.items():
            arguments = (s, v, expected["current"])[: ARGUMENTS[name]]
            points = zip(*(axis.tolist() for axis in arguments), strict=True) if arguments else [()] * s.size
            got = np.array([functions[name](*point, array) for point in points])
            largest = np.abs(wanted).reshape(len(VOLTAGES), -1).max(axis=1).repeat(len(STATES))
            allowed = RELATIVE * np.abs(wanted) + CANCELLED * largest
            worst = int(np.argmax(np.abs(got - wanted) - allowed))
            assert (np.abs(got - wanted) <= allowed).all(), (name, p, s[worst], v[worst], got[worst], wanted[worst])


def test_state_rate_is_zero_where_it_points_outward(library_of):
    functions, values = library_of(Device.load("hp_tio2"))
    assert functions["state_rate"](1.0, 1.0, values) == 0.0 < functions["state_rate"](0.0, 1.0, values)
    assert functions["state_rate"](0.0, -1.0, values) == 0.0 > functions["state_rate"](1.0, -1.0, values)


@pytest.mark.parametrize("name", Device.names())
def test_shipped_cards_compile_with_their_own_values(name, library_of):
    device = Device.load(name)
    functions, values = library_of(device)
    assert list(values) == list(device.parameters.values())
    assert functions["current"](0.3, 0.2, values) == pytest.approx(device.conductance(0.3, 0.2) * 0.2, rel=RELATIVE)


def test_a_card_with_any_name_and_source_compiles(need_tool, tmp_path):
    compiler = need_tool("emitted C is not compared here", os.environ.get("CC", ""), "gcc", "clang")
    entries = tuple(CardValue(value=v, source='*/ ??/ \\ /* "µ\n#error no') for v in (1e2, 1e4, 1e-6))
    for name in ("5k, 100 Hz", "double", "µ-Ω", "x*/y"):
        device = Device(name=name, law="linear", source="*/ #error no\\\n??/", values=entries)
        compiled(compiler, tmp_path, "odd", device.emit("c"))
