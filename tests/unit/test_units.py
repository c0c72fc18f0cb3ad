"""Quantities as a person reads them."""

from __future__ import annotations

import pytest

from ohmloom.errors import ParameterError, UnknownNameError
from ohmloom.units import axis_unit, find_unit, format_quantity, known_units, parse_quantity, parse_unit


@pytest.mark.parametrize(("value", "unit", "text"), [
    (0.00152, "s", "1.52 ms"), (0.0, "V", "0 V"), (-0.0031, "V", "-3.1 mV"), (999.9, "ohm", "1 kohm"),
    (999.4, "ohm", "999 ohm"), (1e6, "ohm", "1 Mohm"), (3e-18, "C", "0.003 fC"), (2e13, "ohm", "2e+04 Gohm"),
    (0.25, "1", "0.25"), (0.25, "", "0.25"), (12345.0, "events", "12,345 events"), (float("inf"), "s", "inf s"),
    (float("nan"), "V", "nan V"), (4.7e-6, "F", "4.7 uF"),
])  # fmt: skip
def test_quantities(value, unit, text):
    assert format_quantity(value, unit) == text


def test_digits():
    assert format_quantity(1.23456e-3, "s", digits=5) == "1.2346 ms"


@pytest.mark.parametrize(("text", "base", "factor"), [
    ("A", "A", 1.0), ("uA", "A", 1e-6), ("\u00b5A", "A", 1e-6), ("\u03bcA", "A", 1e-6), (" mV ", "V", 1e-3),
    ("fA", "A", 1e-15), ("pA", "A", 1e-12), ("nA", "A", 1e-9), ("kOhm", "Ohm", 1e3), ("Mohm", "Ohm", 1e6),
    ("G\u03a9", "Ohm", 1e9), ("k\u2126", "Ohm", 1e3), ("ms", "s", 1e-3), ("min", "s", 60.0), ("h", "s", 3600.0),
])  # fmt: skip
def test_units_are_read_as_their_factor_to_si(text, base, factor):
    assert parse_unit(text, base) == factor


@pytest.mark.parametrize(("text", "message"), [
    ("uAmp", "unit: expected one of A, GA, MA, fA, kA, mA, nA, pA, uA, got 'uAmp'. Did you mean 'uA'?"),
    ("UA", "unit: expected one of A, GA, MA, fA, kA, mA, nA, pA, uA, got 'UA'. Did you mean 'uA'?"),
    ("furlong", "unit: expected one of A, GA, MA, fA, kA, mA, nA, pA, uA, got 'furlong'. Use one of these."),
    ("mV", "unit: expected a unit of A, such as mA, got 'mV', a unit of V. Check that this is the right quantity."),
    ("min", "unit: expected a unit of A, such as mA, got 'min', a unit of s. Check that this is the right quantity."),
])  # fmt: skip
def test_what_is_no_unit_of_a_current_is_refused(text, message):
    with pytest.raises(UnknownNameError) as caught:
        parse_unit(text, "A")
    assert str(caught.value) == message


def test_a_unit_is_a_text():
    with pytest.raises(ParameterError, match=r"^unit of i: expected str, got 3\. Pass a value of this type\.$"):
        parse_unit(3, "A", where="unit of i")


def test_only_times_are_counted_in_minutes():
    assert find_unit("min", "V") is None
    assert known_units("s")["min"] == 60.0
    assert "min" not in known_units("V")


@pytest.mark.parametrize(("text", "base", "value"), [
    ("5", "Ohm", 5.0), ("5k", "Ohm", 5000.0), ("5kOhm", "Ohm", 5000.0), (" 5 k\u03a9 ", "Ohm", 5000.0),
    ("0.1V", "V", 0.1), ("100mV", "V", 0.1), ("1m", "s", 1e-3), ("1min", "s", 60.0), (".5e3", "Hz", 500.0),
    ("-3uA", "A", -3e-6), ("2.", "", 2.0), ("3 1/V", "1/V", 3.0),
])  # fmt: skip
def test_quantity_is_read_with_or_without_its_unit_and_is_the_nearest_float(text, base, value):
    assert parse_quantity(text, base) == value


@pytest.mark.parametrize(("text", "base", "message"), [
    ("x", "Ohm", "quantity: expected a number in Ohm, such as 5 or 5kOhm, got 'x'. Correct it."),
    ("1e999", "V", "quantity: expected a number in V, such as 5 or 5kV, got '1e999'. Correct it."),
    ("1_000", "", "quantity: expected a number without a unit, got '1_000'. Leave '_000' out."),
    ("3V", "1/V", "quantity: expected a number in 1/V, got '3V'. Leave 'V' out."),
    ("3k", "", "quantity: expected a number without a unit, got '3k'. Leave 'k' out."),
    ("nan", "", "quantity: expected a number, got 'nan'. Correct it."),
    ("5 kA", "V", "quantity: expected a unit of V, such as mV, got 'kA', a unit of A. Check that this is the right "
                  "quantity."),
])  # fmt: skip
def test_quantity_that_is_none_is_refused(text, base, message):
    with pytest.raises(ParameterError) as caught:
        parse_quantity(text, base)
    assert str(caught.value) == message


@pytest.mark.parametrize(("largest", "unit", "expected"), [
    (199.0, "A", (1.0, "A")), (200.0, "A", (1e-3, "kA")), (-0.19, "A", (1e3, "mA")), (1.5e-4, "A", (1e6, "uA")),
    (3e-17, "C", (1e15, "fC")), (1e13, "Ohm", (1e-9, "GOhm")), (750.0, "s", (1.0, "s")), (0.0, "V", (1.0, "V")),
    (1e-4, "1/s", (1.0, "1/s")), (float("inf"), "V", (1.0, "V")),
])  # fmt: skip
def test_axis_gets_the_prefix_that_makes_its_numbers_readable(largest, unit, expected):
    assert axis_unit(largest, unit) == expected
