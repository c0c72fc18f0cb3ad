"""Asking a device: values, shapes, inverse, and the text of every refusal."""

from __future__ import annotations

import dataclasses
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import ohmloom.devices as room
from ohmloom.devices import CardValue, Device
from ohmloom.errors import MissingFileError, ParameterError, UnknownNameError

HP = Device.load("hp_tio2")
# Cards whose law names the memristances of both ends.
WITH_ENDS = [name for name in Device.names() if "r_on" in Device.load(name).parameters]


def test_public_names_are_these():
    assert room.__all__ == [
        "LAWS", "CardValue", "Comparison", "DataFile", "Device", "Fit", "Law", "Measurement", "Parameter", "Revisit",
        "Trace", "charge_revisit", "compare", "fit",
    ]  # fmt: skip
    assert all(hasattr(room, name) for name in room.__all__)


def test_output_rank_follows_input_rank():
    assert type(HP.conductance(0.5)) is float
    assert type(HP.memristance(0.5)) is float
    assert type(HP.weight(0.5)) is float
    assert type(HP.state_at_weight(0.5)) is float
    assert HP.conductance(np.full((2, 3), 0.5)).shape == (2, 3)
    assert HP.conductance(0.5, v=np.zeros(4)).shape == (4,)
    assert HP.state_at_weight(np.full((2, 1), 0.5)).shape == (2, 1)
    assert HP.state_at_weight(np.empty(0)).shape == (0,)


@pytest.mark.parametrize("name", WITH_ENDS)
def test_conductance_memristance_and_weight_agree_at_the_walls(name):
    device = Device.load(name)
    r_on, r_off = device.parameters["r_on"], device.parameters["r_off"]
    assert device.memristance(0.0) == pytest.approx(r_off, rel=4e-16)
    assert device.memristance(1.0) == pytest.approx(r_on, rel=1e-14)
    assert device.conductance(0.3) * device.memristance(0.3) == pytest.approx(1.0, rel=4e-16)
    assert device.weight(1.0) == 1.0
    assert device.weight(0.0) == pytest.approx(r_on / r_off, rel=1e-14)


@pytest.mark.parametrize("name", Device.names())
@given(fraction=st.floats(0.0, 1.0))
def test_state_at_weight_inverts_weight(name, fraction):
    device = Device.load(name)
    low = device.weight(0.0)
    w = min(low + (1.0 - low) * fraction, 1.0)
    s = device.state_at_weight(w)
    assert 0.0 <= s <= 1.0
    # W changes by at most 160 times the change of s, which is exact to a rounding. Pickett's conductance at 0 V is the
    # difference of two flows that are equal to 1e-3.
    assert device.weight(s) == pytest.approx(w, abs=1e-12 if device.law == "pickett" else 1e-13)


def test_state_at_the_papers_start_weight():
    # W = 0.5: 0.01/(1 - q), 1.01 - 0.01/(0.01 + q), 0.01 + q, each with s = q/0.99.
    assert Device.load("hp_tio2_paper").state_at_weight(0.5) == pytest.approx(0.98 / 0.99, rel=1e-14)
    assert Device.load("peo_pani_paper").state_at_weight(0.5) == pytest.approx((0.01 / 0.51 - 0.01) / 0.99, rel=1e-13)
    assert Device.load("linear_paper").state_at_weight(0.5) == pytest.approx(0.49 / 0.99, rel=1e-14)


@pytest.mark.parametrize("name", WITH_ENDS)
def test_the_ends_of_the_weight_range_are_walls_even_when_rounded(name):
    device = Device.load(name)
    low = device.parameters["r_on"] / device.parameters["r_off"]
    for w in (low, low * (1 - 1e-13), low * (1 + 1e-15)):
        assert device.state_at_weight(w) <= 1e-14
    assert device.state_at_weight(1.0) == pytest.approx(1.0, abs=1e-15)


def test_replace_changes_the_value_its_source_and_the_digest_only():
    other = HP.replace(r_off=32e3)
    assert other.parameters == {**HP.parameters, "r_off": 32e3}
    assert other.sources["r_off"] == "set by the caller of Device.replace"
    assert other.sources["r_on"] == HP.sources["r_on"]
    assert other.sha256 != HP.sha256
    assert HP.parameters["r_off"] == 16e3
    assert HP.replace() == HP


def test_a_device_is_frozen_hashable_and_travels_between_processes():
    with pytest.raises(dataclasses.FrozenInstanceError):
        HP.name = "other"
    HP.parameters["r_on"] = 1.0
    assert HP.parameters["r_on"] == 100.0
    assert hash(pickle.loads(pickle.dumps(HP))) == hash(HP)


def test_a_device_in_a_notebook_is_escaped():
    value = CardValue(value=1.0, source="<b>&")
    device = Device(
        name="<script>",
        law="linear",
        source="x",
        values=(value, dataclasses.replace(value, value=2.0), value),
    )
    page = device._repr_html_()
    assert "&lt;script&gt;" in page
    assert "&lt;b&gt;&amp;" in page
    assert "<script>" not in page
    assert "<td>2 Ohm</td>" in page


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: HP.replace(r_on=2e4),
            "hp_tio2.r_on: expected 0 < r_on < r_off = 16000 Ohm, got 20000 Ohm. Lower r_on or raise r_off.",
        ),
        (
            lambda: HP.replace(r_on=-1.0, beta=0.0),
            "hp_tio2.r_on: expected 0.001 <= r_on <= 1000000000000 Ohm, got -1 Ohm. "
            "Raise it; check its unit.\n"
            "hp_tio2.beta: expected 1e-09 <= beta <= 1e+15 1/(V s), got 0 1/(V s). Raise it; check its unit.",
        ),
        (
            lambda: HP.replace(ron=1.0),
            "hp_tio2.replace: expected one of beta, r_off, r_on, got 'ron'. Did you mean 'r_on'?",
        ),
        (
            lambda: HP.replace(r_on="hello"),
            "hp_tio2.r_on: expected a finite number in SI units, got 'hello'. Correct it.",
        ),
        (
            lambda: HP.replace(r_on=True),
            "hp_tio2.r_on: expected a finite number in SI units, got True. Correct it.",
        ),
        (
            lambda: HP.replace(r_on=float("nan")),
            "hp_tio2.r_on: expected a finite number in SI units, got nan. Correct it.",
        ),
        (
            lambda: HP.conductance([0.5, 1.5]),
            "hp_tio2: s: expected 0 <= s <= 1, got 1.5. Divide a charge by charge_scale = 9.9375e-05 C.",
        ),
        (
            lambda: HP.memristance(-1e-9),
            "hp_tio2: s: expected 0 <= s <= 1, got -1e-09. Divide a charge by charge_scale = 9.9375e-05 C.",
        ),
        (
            lambda: HP.weight(float("nan")),
            "hp_tio2: s: expected finite numbers, got NaN or infinity. Check the input.",
        ),
        (lambda: HP.weight("half"), "hp_tio2: s: expected numbers, got 'half'. Pass floats."),
        (
            lambda: HP.conductance(0.5, v=float("inf")),
            "hp_tio2.conductance: v: expected finite numbers, got NaN or infinity. Check the input.",
        ),
        (
            lambda: HP.conductance([0.1, 0.2], v=[0.0, 0.0, 0.0]),
            "hp_tio2.conductance: expected s and v of shapes that broadcast, got (2,) and (3,). "
            "Give one voltage per state, or a single one.",
        ),
        (
            lambda: HP.state_at_weight([0.5, 0.001]),
            "hp_tio2.state_at_weight: expected 0.00625 = G_off/G_on <= w <= 1, got 0.001. "
            "Choose a weight that the device can hold.",
        ),
        (
            lambda: HP.state_at_weight(1.01),
            "hp_tio2.state_at_weight: expected 0.00625 = G_off/G_on <= w <= 1, got 1.01. "
            "Choose a weight that the device can hold.",
        ),
        (
            lambda: Device(name="x", law="hp", source="x", values=()),
            f"Device.law: expected one of {', '.join(sorted(room.LAWS))}, got 'hp'. Use one of these.",
        ),
        (
            lambda: Device(name="x", law="linear", source="x", values=()),
            "Device.values: expected one CardValue for each of r_on, r_off, q_d, got 0. Give them in this order.",
        ),
    ],
)
def test_a_refusal_says_what_was_expected(call, message):
    with pytest.raises(ParameterError) as caught:
        call()
    assert str(caught.value) == message


def test_an_unknown_parameter_can_be_caught_as_a_key_error():
    with pytest.raises(KeyError) as caught:
        HP.replace(r_of=1.0)
    assert isinstance(caught.value, UnknownNameError)


@pytest.mark.parametrize("value", [10**400, 10**5000, None], ids=["long", "longer", "none"])
def test_numbers_beyond_a_float_are_refused(value):
    with pytest.raises(ParameterError, match=r"^hp_tio2\.r_on: expected a finite number in SI units, got "):
        HP.replace(r_on=value)


@pytest.mark.parametrize("name", [None, 5, b"x"])
def test_what_is_no_name_or_path(name):
    with pytest.raises(ParameterError, match=r"^Device\.load: expected a card's name or path, got "):
        Device.load(name)


def test_names_that_no_file_can_have():
    for name in ("a" * 5000, "a\0b", "a\0b.toml", "a" * 5000 + ".toml"):
        with pytest.raises(MissingFileError):
            Device.load(name)


@pytest.mark.parametrize("state", [True, "0.5", ["0.5"], [True, False]])
def test_text_and_booleans_are_no_states(state):
    with pytest.raises(ParameterError, match=r"^hp_tio2: s: expected numbers, got "):
        HP.conductance(state)


def test_a_voltage_beyond_that_of_simulate_is_refused():
    with pytest.raises(
        ParameterError, match=r"^hp_tio2\.conductance: v: expected at most 1e\+06 V in size, got 1e\+300"
    ):
        HP.conductance(0.5, v=1e300)


def test_a_law_that_is_no_name_is_told():
    with pytest.raises(UnknownNameError, match=r"^Device\.law: expected one of .*, got 5\. Use one of these\.$"):
        Device(name="x", law=5, source="x", values=())
