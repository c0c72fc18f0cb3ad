"""Pickett's model of HP's TiO2 memristor: a tunnel gap whose width is moved by the current.

Equation (M. D. Pickett et al., J. Appl. Phys. 106 (2009) 074508; as fig. 8 and eqs. 9 and 10 of S. Kvatinsky et al.,
TEAM, IEEE Trans. Circuits Syst. I 60 (2013) 211). Switching off, ``dw/dt = f_off sinh(|i|/i_off) exp(-exp((w -
a_off)/w_c - |i| /b) - w/w_c)``; on, ``dw/dt = -f_on sinh(|i|/i_on) exp(-exp(-(w - a_on)/w_c - |i|/b) - w/w_c)``. The
gap conducts by J. G. Simmons' formula for a rectangular barrier with image force (J. Appl. Phys. 34 (1963) 1793), in
series with r_s. Published, positive current switches off; here the terminals are exchanged, so that positive
current, into the first terminal, narrows the gap, ``s = (w_max - w)/(w_max - w_min)``, and raises G.

Range of validity: a reference generator for gap voltages below the barrier: 0.9 V, less for a gap under 1.2 nm.
Beyond, the barrier is held where the formula's forward current is largest, and past 0.9 V, as within +-1 mV, the gap
conducts as a resistor. A width has no charge: q_d = 1 C, nominal.
"""

from __future__ import annotations

import math

from ohmloom.devices.laws._functions import bounded_exp, bounded_sinh, larger, log, smaller, sqrt
from ohmloom.devices.laws._law import Law, Parameter, Parameters, Rounds, Value
from ohmloom.devices.laws._shared import NOMINAL_CHARGE

ELEMENTARY_CHARGE, PLANCK, VACUUM_PERMITTIVITY = 1.602176634e-19, 6.62607015e-34, 8.8541878128e-12  # SI 2019
DECAY = 10.246e9  # 1/(m sqrt(V)): 4 pi sqrt(2 m e)/h
CURRENT_SCALE = ELEMENTARY_CHARGE**2 / (2.0 * math.pi * PLANCK)  # A/V
IMAGE_FORCE = ELEMENTARY_CHARGE * math.log(2.0) / (8.0 * math.pi * VACUUM_PERMITTIVITY)  # V m
SMALLEST_GAP_VOLTAGE, LARGEST_GAP_VOLTAGE = 1e-3, 0.9  # V
# Newton's rule from above on a convex curve; its slope comes from a difference, so each round gains five digits.
ROUNDS, DIFFERENCE = 9, 1e-6


def conductance(s: Value, v: Value, p: Parameters) -> Value:
    """G of gap and series resistor, the gap's voltage found by Newton's rule."""
    u = _start(s, v, p)
    for _ in range(ROUNDS):
        u = _advance(u, s, v, p)
    return _finish(u, s, v, p)


def _start(s: Value, v: Value, p: Parameters) -> Value:
    """The share that the gap's low-field conductance would leave to it.

    Its current is convex below the largest gap voltage, so Newton's rule falls to the root from anything above it.
    """
    w = _width(s, p)
    return smaller(abs(v) / (1.0 + p[8] * _gap_conductance(w, 0.0, p)), _largest_voltage(w, p))


def _advance(u: Value, s: Value, v: Value, p: Parameters) -> Value:
    w, size = _width(s, p), abs(v)
    step = DIFFERENCE * (u + SMALLEST_GAP_VOLTAGE)
    excess = u + p[8] * u * _gap_conductance(w, u, p) - size
    before = u - step + p[8] * (u - step) * _gap_conductance(w, u - step, p) - size
    return larger(u - excess * step / (excess - before), 0.0)


def _finish(u: Value, s: Value, v: Value, p: Parameters) -> Value:
    """G with the gap at `u`, or, past the largest gap voltage, where the gap is a resistor."""
    w = _width(s, p)
    largest = _largest_voltage(w, p)
    ohmic = abs(v) / (1.0 + p[8] * _gap_conductance(w, largest, p))
    is_ohmic = ohmic >= largest
    g = _gap_conductance(w, is_ohmic * ohmic + (1.0 - is_ohmic) * u, p)
    return g / (1.0 + p[8] * g)


def _balance(g: Value, s: Value, v: Value, p: Parameters) -> Value:
    """The gap's conductance at the voltage that the series resistor leaves to it, in series with that, less G."""
    gap = _gap_conductance(_width(s, p), abs(v) * (1.0 - p[8] * g), p)
    return gap * (1.0 - p[8] * g) - g


def charge_rate(s: Value, v: Value, i: Value, p: Parameters) -> Value:
    """The speed of the gap's wall over its range, in units of the nominal charge."""
    w, size = _width(s, p), abs(i)
    lift = size / p[6]
    on = p[1] * bounded_sinh(size / p[3]) * bounded_exp(-bounded_exp(-(w - p[5]) / p[7] - lift) - w / p[7])
    off = p[0] * bounded_sinh(size / p[2]) * bounded_exp(-bounded_exp((w - p[4]) / p[7] - lift) - w / p[7])
    return ((i > 0.0) * on - (i < 0.0) * off) / (p[13] - p[12]) * NOMINAL_CHARGE


def charge_scale(p: Parameters) -> Value:
    """q_d = 1 C, nominal."""
    return NOMINAL_CHARGE


def _width(s: Value, p: Parameters) -> Value:
    return p[13] - (p[13] - p[12]) * s


def _image(w: Value, p: Parameters) -> Value:
    """lambda, the voltage of the image force."""
    return IMAGE_FORCE / (p[11] * w)


def _largest_voltage(w: Value, p: Parameters) -> Value:
    """Where the formula's barrier has lost most of its thickness: 9.2 lambda/(3 phi_0 + 4 lambda - 2 u) = 0.8."""
    return smaller(1.5 * p[9] - 3.75 * _image(w, p), LARGEST_GAP_VOLTAGE)


def _gap_conductance(w: Value, u: Value, p: Parameters) -> Value:
    """Simmons' current over the gap's voltage `u` >= 0, for a gap of width `w`."""
    held = smaller(larger(u, SMALLEST_GAP_VOLTAGE), _largest_voltage(w, p))
    image = _image(w, p)
    w1 = 1.2 * image * w / p[9]
    w2 = w1 + w * (1.0 - 9.2 * image / (3.0 * p[9] + 4.0 * image - 2.0 * held))
    thickness = w2 - w1
    bent = held * (w1 + w2) / (2.0 * w) + 1.15 * image * w / thickness * log(w2 * (w - w1) / (w1 * (w - w2)))
    decay = DECAY * thickness
    # Under it the formula's forward current would fall with a growing voltage: there the barrier is gone.
    barrier = larger(p[9] - bent, (2.0 / decay) ** 2)
    forward = barrier * bounded_exp(-decay * sqrt(barrier))
    backward = (barrier + held) * bounded_exp(-decay * sqrt(barrier + held))
    return CURRENT_SCALE * p[10] / thickness**2 * (forward - backward) / held


def _make(name: str, unit: str, default: float, lower: float, upper: float, doc: str) -> Parameter:
    return Parameter(name=name, unit=unit, default=default, lower=lower, upper=upper, scale="log", doc=doc)


LAW = Law(
    name="pickett",
    parameters=(
        _make("f_off", "m/s", 3.5e-6, 1e-12, 1.0, "speed of switching off"),
        _make("f_on", "m/s", 40e-6, 1e-12, 1.0, "speed of switching on"),
        _make("i_off", "A", 115e-6, 1e-9, 1.0, "current scale of switching off"),
        _make("i_on", "A", 8.9e-6, 1e-9, 1.0, "current scale of switching on"),
        _make("a_off", "m", 1.2e-9, 0.5e-9, 3e-9, "width at which switching off stops"),
        _make("a_on", "m", 1.8e-9, 0.5e-9, 3e-9, "width at which switching on stops"),
        _make("i_stop", "A", 500e-6, 1e-9, 1.0, "b: current that shifts the stop by w_c"),
        _make("w_c", "m", 107e-12, 1e-12, 1e-9, "characteristic width"),
        _make("r_s", "Ohm", 215.0, 1e-3, 1e9, "series resistance of the electrodes and the conducting channel"),
        _make("barrier", "V", 0.95, 0.7, 5.0, "phi_0: height of the tunnel barrier"),
        _make("area", "m^2", 1e-14, 1e-18, 1e-8, "area of the gap"),
        _make("permittivity", "1", 5.0, 3.0, 100.0, "relative permittivity of the gap"),
        _make("w_min", "m", 1.0e-9, 0.9e-9, 3e-9, "width at s = 1"),
        _make("w_max", "m", 1.9e-9, 0.9e-9, 5e-9, "width at s = 0"),
    ),
    conductance=conductance,
    charge_rate=charge_rate,
    charge_scale=charge_scale,
    is_fittable=False,
    rounds=Rounds(count=ROUNDS, start=_start, advance=_advance, finish=_finish, balance=_balance),
    doc="Pickett: HP's TiO2 as a tunnel gap moved by the current (reference generator)",
)
