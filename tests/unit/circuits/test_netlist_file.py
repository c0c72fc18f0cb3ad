"""``*.netlist.json``: what is written is read again, and every problem is named with its place."""

from __future__ import annotations

import json

import pytest

from ohmloom.circuits import (
    VCCS,
    VCVS,
    Capacitor,
    CurrentSource,
    Memristor,
    Netlist,
    PiecewiseLinear,
    Pulse,
    Resistor,
    Sine,
    Subcircuit,
    TwoPartSpike,
    VoltageSource,
)
from ohmloom.circuits.elements import ELEMENTS
from ohmloom.circuits.waveforms import WAVEFORMS, Waveform
from ohmloom.devices import Device
from ohmloom.errors import FileFormatError, MissingFileError, OperationError, ParameterError

SPIKE = TwoPartSpike(first=1.0, second=-1.0, first_width=1e-3, second_width=1e-3, edge=1e-6, period=4e-3)
HALF = Netlist(name="half", ports=("a", "b"), elements=(
    Resistor(name="R1", p="a", n="mid", resistance=500.0), Resistor(name="R2", p="mid", n="b", resistance=0.0),
))  # fmt: skip
WHOLE = Netlist(name="whole", ports=("p",), elements=(Subcircuit(name="X", netlist=HALF, nodes={"a": "p", "b": "0"}),))
FULL = Netlist(name="full", t_end=0.02, elements=(
    VoltageSource(name="V1", p="a", n="0", voltage=Pulse(high=1.0, rise=1e-4, width=1e-3, fall=1e-4)),
    VoltageSource(name="V2", p="b", n="0", voltage=0.5),
    CurrentSource(name="I1", p="a", n="b", current=PiecewiseLinear(times=(0.0, 1e-3), values=(0.0, 1e-3))),
    CurrentSource(name="I2", p="a", n="b", current=Sine(amplitude=1e-3, frequency=50.0)),
    CurrentSource(name="I3", p="a", n="b", current=SPIKE),
    Capacitor(name="C1", p="c", n="0", capacitance=1e-9, initial=0.1),
    Memristor(name="M1", p="c", n="b", device=Device.load("hp_tio2"), s0=0.2),
    Memristor(name="M2", p="c", n="b", device=Device.load("hp_tio2").replace(r_on=2.5), s0=0.2),
    VCVS(name="E1", p="e", n="0", control_p="a", control_n="b", gain=2.0),
    VCCS(name="G1", p="e", n="c", control_p="a", control_n="b", transconductance=1e-3),
    Subcircuit(name="Y", netlist=WHOLE, nodes={"p": "e"}),
))  # fmt: skip


@pytest.fixture
def path(tmp_path):
    FULL.save(tmp_path / "full.netlist.json")
    return tmp_path / "full.netlist.json"


def test_example_holds_every_element_and_waveform():
    assert {type(e) for e in (*FULL.elements, *HALF.elements)} == set(ELEMENTS.values())
    waveforms = {type(v) for e in FULL.elements for v in vars(e).values() if isinstance(v, Waveform)}
    assert waveforms == set(WAVEFORMS.values())


def test_netlist_survives_a_file(path):
    again = Netlist.load(path)
    assert again == FULL
    text = path.read_text()
    again.save(path)
    assert path.read_text() == text
    assert json.loads(text)["format"] == "ohmloom.netlist"


def test_card_of_ones_own_stands_beside_the_netlist(path):
    named = {e["name"]: e["device"] for e in json.loads(path.read_text())["elements"] if e["element"] == "memristor"}
    assert named == {"M1": "hp_tio2", "M2": "hp_tio2.toml"}
    assert Device.load(path.parent / "hp_tio2.toml").parameters["r_on"] == 2.5
    Device.load("linear").save(path.parent / "hp_tio2.toml")
    with pytest.raises(
        OperationError, match=r"hp_tio2\.toml: expected no file or the card of hp_tio2, got another one"
    ):
        FULL.save(path)


def test_ports_belong_to_subcircuits(tmp_path):
    with pytest.raises(ParameterError, match="expected a netlist without ports, got a, b"):
        HALF.save(tmp_path / "half.netlist.json")


DAMAGE = {
    "version": ('"version": 1', '"version": 2', "version: expected 1, got 2"),
    "resistance": ('"resistance": 500.0', '"resistance": -5', "half.elements[0]: R1.resistance: expected 0 Ohm"),
    "waveform": ('"pulse"', '"puls"', "elements[0].voltage: waveform: expected one of"),
    "waveform's hint": ('"pulse"', '"puls"', "got 'puls'. Did you mean 'pulse'?"),
    "zero rise": ('"rise": 0.0001', '"rise": 0', "elements[0]: Pulse.rise: expected a number above 0 s"),
    "unknown key": ('"rise"', '"ris"', "voltage: ris: expected no such key, got 0.0001. Did you mean 'rise'?"),
    "kind": ('"resistor"', '"resist"', "subcircuits.half.elements[0]: element: expected one of"),
    "number": ('"capacitance": 1e-09', '"capacitance": "x"', "elements[5]: capacitance: expected a valid number"),
    "subcircuit": ('"subcircuit": "whole"', '"subcircuit": "hole"', "elements[10]: subcircuit: expected one that"),
    "port": ('"p": "e"\n', '"q": "e"\n', "elements[10]: Y.nodes: expected one of p, got 'q'"),
    "twice": ('"name": "V2"', '"name": "V1"', "Netlist.elements: expected each element's name once"),
    "t_end": ('"t_end": 0.02', '"t_end": -1.0', "Netlist.t_end: expected a time above 0 s, got -1 s"),
}  # fmt: skip


@pytest.mark.parametrize("case", DAMAGE)
def test_problem_is_named_with_file_and_place(case, path):
    old, new, wanted = DAMAGE[case]
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(FileFormatError) as caught:
        Netlist.load(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert wanted in str(caught.value)


def test_every_problem_is_gathered(path):
    text = path.read_text()
    for old, new in (('"rise"', '"rises"'), ('"gain": 2.0', '"gain": "x"'), ('"s0": 0.2', '"s0": 2')):
        text = text.replace(old, new)
    path.write_text(text)
    with pytest.raises(FileFormatError) as caught:
        Netlist.load(path)
    # A key too few and one too many, the states of two memristors, a gain.
    assert len(caught.value.problems) == 5


def test_missing_card_is_told(path):
    path.write_text(path.read_text().replace('"hp_tio2"', '"hp_tio"'))
    with pytest.raises(MissingFileError, match="Did you mean 'hp_tio2'"):
        Netlist.load(path)
