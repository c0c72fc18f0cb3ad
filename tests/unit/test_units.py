"""Quantities as a person reads them."""

from __future__ import annotations

import pytest

from ohmloom.units import format_quantity


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
