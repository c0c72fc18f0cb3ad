"""Emitted text: names, refusals, numbers, and the operations that a law may use. Tools judge it in tests/cross."""

from __future__ import annotations

import dataclasses
import math
import re
import subprocess
import sys

import pytest

from ohmloom.devices import LAWS, CardValue, Device, Parameter
from ohmloom.devices._symbolic import Dialect, trace, write
from ohmloom.devices.emit import DIALECTS, check_names, identifier
from ohmloom.errors import OperationError, ParameterError, UnknownNameError

HP = Device.load("hp_tio2")
TEXT = Dialect(functions={})


def law_with(conductance, *names):
    """The linear law with other parameter names, and a conductance of its own."""
    template = LAWS["linear"].parameters[0]
    parameters = tuple(dataclasses.replace(template, name=name) for name in names)
    return dataclasses.replace(
        LAWS["linear"], name="mine", parameters=parameters, conductance=conductance, charge_scale=lambda p: 1.0
    )


def formula(conductance, *names):
    """What `write` makes of a conductance: its assignments as one string."""
    steps = write(trace(law_with(conductance, *names), "conductance"), TEXT)
    return "; ".join(f"{step.name} = {step.text}" for step in steps)


@pytest.mark.parametrize("to", DIALECTS)
@pytest.mark.parametrize("name", Device.names())
def test_text_is_deterministic_and_names_its_origin(name, to):
    device = Device.load(name)
    text = device.emit(to)
    assert text == Device.load(name).emit(to)
    assert text.endswith("\n")
    assert text.isascii()
    assert not any(line != line.rstrip() for line in text.splitlines())
    from importlib.metadata import version

    assert device.sha256 in text
    assert f"ohmloom {version('ohmloom')}" in text
    for value in device.parameters.values():
        assert repr(value) in text


@pytest.mark.parametrize("to", DIALECTS)
@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_every_law_is_emitted_and_no_line_is_long(law, to):
    entries = tuple(CardValue(value=parameter.default, source="default") for parameter in law.parameters)
    text = Device(name="any", law=law.name, source="defaults", values=entries).emit(to)
    assert not re.search(r"\b(nan|inf)\b", text)
    assert max(map(len, text.splitlines())) <= 120


def test_small_laws_read_as_a_person_writes_them():
    assert "    return 1.0 / (r_off * (1.0 - s) + r_on * s);\n" in HP.emit("c")
    assert "\nBi i 0 V = V(p,n) / ({r_off} * (1.0 - V(s)) + {r_on} * V(s))\n" in HP.emit("spice")
    assert "        i = v / (r_off * (1.0 - s) + r_on * s);\n" in HP.emit("verilog-a")


@pytest.mark.parametrize(
    ("conductance", "expected"),
    [
        (lambda s, v, p: s - (v - p[0]), "conductance = s - (v - a)"),
        (lambda s, v, p: s / (v / p[0]), "conductance = s / (v / a)"),
        (lambda s, v, p: -(s + v) * p[0], "conductance = -((s + v) * a)"),
        (lambda s, v, p: s - -2.5 * v, "conductance = s - (-2.5) * v"),
        (lambda s, v, p: (s > 0.5) * v, "conductance = (0.5 < s ? 1.0 : 0.0) * v"),
        (lambda s, v, p: abs(s) ** 2.5, "conductance = pow(fabs(s), 2.5)"),
        (lambda s, v, p: (s * v + p[0]) ** 2, "t0 = s * v + a; conductance = t0 * t0"),
    ],
)
def test_formulas_keep_their_meaning(conductance, expected):
    assert formula(conductance, "a") == expected


def test_a_law_that_is_zero_is_written():
    assert formula(lambda s, v, p: 0.0 * s, "a") == "conductance = 0.0"


def test_an_operation_that_no_language_has_is_refused():
    import casadi

    law = law_with(lambda s, v, p: casadi.erf(s), "a")
    with pytest.raises(OperationError) as caught:
        trace(law, "conductance")
    assert str(caught.value) == (
        "mine: expected operations that C, SPICE and Verilog-A have, got CasADi's ERF. "
        "Write the law with + - * / ** and the functions of ohmloom.devices.laws._functions."
    )


def test_an_infinite_constant_is_refused():
    with pytest.raises(OperationError, match=r"mine: expected finite constants, got inf\. Correct the law\."):
        trace(law_with(lambda s, v, p: s + math.inf * v, "a"), "conductance")


@pytest.mark.parametrize(
    "name", [*"pnxsviq", "s0", "t0", "T12", "exp", "double", "time", "TEMPER", "module", "electrical"]
)
def test_names_that_are_taken_are_refused(name):
    with pytest.raises(ParameterError) as caught:
        check_names(law_with(LAWS["linear"].conductance, "r_on", name))
    assert str(caught.value) == (
        f"mine.{name}: expected a name that is free in C, SPICE and Verilog-A, and not one of the emitted model's own, "
        f"got {name!r}. Rename the parameter."
    )


@pytest.mark.parametrize(("names", "rule"), [(("a b",), "letters, digits and _"), (("k", "K"), "more than the case")])
def test_names_that_are_no_identifiers_or_clash_are_refused(names, rule):
    with pytest.raises(ParameterError, match=rule):
        check_names(law_with(LAWS["linear"].conductance, *names))


def test_emit_checks_the_names(monkeypatch):
    law = dataclasses.replace(
        LAWS["linear"], parameters=(*LAWS["linear"].parameters[:2], Parameter(
            name="n", unit="C", default=1.0, lower=0.1, upper=10.0, scale="log", doc="clashes with a port"
        )),
    )  # fmt: skip
    monkeypatch.setitem(LAWS, "linear", law)
    entries = tuple(CardValue(value=value, source="test") for value in (1e2, 1e4, 1.0))
    with pytest.raises(ParameterError, match=r"linear\.n: expected a name that is free"):
        Device(name="any", law="linear", source="test", values=entries).emit("verilog-a")


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_no_law_has_a_name_that_is_taken(law):
    check_names(law)


def test_unknown_language():
    with pytest.raises(UnknownNameError, match=r"expected one of c, spice, verilog-a, got 'verilog'\. Did you mean"):
        HP.emit("verilog")
    with pytest.raises(ParameterError, match="expected a name of a language, got None"):
        HP.emit(None)


@pytest.mark.parametrize("name", ["", "5k", "µ", "t3", "double", "a-b", "x"])
def test_identifiers_are_free(name):
    assert re.fullmatch(r"[A-Za-z]\w*", identifier(name), re.ASCII)
    assert identifier(name) not in ("double", "t3", "x")


def test_texts_of_a_card_cannot_leave_their_comment():
    entries = tuple(CardValue(value=value, source="a */ b\nmodule \\") for value in (1e2, 1e4, 1e-6))
    device = Device(name="odd", law="linear", source="*/ int x;\n.end\n", values=entries)
    assert device.emit("c").count("*/") == HP.emit("c").count("*/")
    assert not any(line.startswith(".end") and line != ".ends odd" for line in device.emit("spice").splitlines())
    assert sum(line.startswith("module") for line in device.emit("verilog-a").splitlines()) == 1


def test_importing_devices_does_not_import_casadi():
    code = "import sys, ohmloom.devices, ohmloom.devices.emit; print('casadi' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"
