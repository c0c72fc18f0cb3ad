"""An ngspice subcircuit: the state is the voltage of a 1 F capacitor, everything else a behavioural source."""

from __future__ import annotations

import textwrap

from ohmloom.devices._symbolic import WIDTH, Dialect, trace, write
from ohmloom.devices.laws import Law

# Share of the state's range over which an outward rate fades at a wall: a hard stop has no derivative for Newton's
# iteration.
WALL = 1e-6
# A time step that ends beyond a wall is taken back while the rate points outward, slowly enough to be smooth.
OVERSHOOT = 1e-3
# Holds the state at s0 in analyses that have no time; 30 000 years is longer than any transient.
LEAK = 1e12  # Ohm; with 1 F a time constant in s

SPICE = Dialect(
    # Newton's iteration passes through arguments that the law never has, and ngspice stops at them.
    functions={
        "log": "ln(max({}, 1e-300))",
        "sqrt": "sqrt(max({}, 0.0))",
        "fabs": "abs({})",
        "fmin": "min({})",
        "fmax": "max({})",
    },
    variable=lambda name: "V(p,n)" if name == "v" else f"V({name})",
    parameter=lambda name: f"{{{name}}}",
)


def emit_spice(name: str, header: list[str], law: Law, values: tuple[float, ...]) -> str:
    """The text of a file to `.include`."""
    steps = write(trace(law, "charge_scale", "i", "rate"), SPICE)
    given = " ".join(f"{key}={value!r}" for key, value in zip(law.parameter_names, values, strict=True))
    body = [f".subckt {name} p n params: {given} s0=0.5"]
    body += [f".param {step.name}={{{step.text}}}" for step in steps if step.is_fixed]
    body += ["Bs s 0 V = min(max(V(x), 0.0), 1.0)"]
    body += [f"B{step.name} {step.name} 0 V = {step.text}" for step in steps if not step.is_fixed]
    body += [
        "Bport p n I = V(i)",
        f"Bx 0 x I = max(V(rate), 0.0) * {_fade('(1.0 - V(x))')} + min(V(rate), 0.0) * {_fade('V(x)')}",
        "Cx x 0 1.0 ic={s0}",
        ".ic v(x)={s0}",
        f"Rx x start {LEAK!r}",
        "Vstart start 0 {s0}",
        "Bq q 0 V = {charge_scale} * V(s)",
        f".ends {name}",
    ]
    notes = [
        *header,
        "",
        f"Use: .include this file, then  Xm a b {name} s0=0.2  with any parameter set on the same line.",
        "Node x holds the state, q the state charge in C (V(xm.q)), i the current in A, rate ds/dt in 1/s. An outward",
        f"rate fades to 0 over the last {WALL!r} of s. s0 holds in .tran, also with uic; .op finds where s rests.",
    ]
    return "\n".join([*(f"* {note}".rstrip() for note in notes), *(_continued(line) for line in body)]) + "\n"


def _fade(distance: str) -> str:
    return f"min(max({distance} / {WALL!r}, {distance} / {OVERSHOOT!r}), 1.0)"


def _continued(line: str) -> str:
    pieces = textwrap.wrap(line, WIDTH, break_long_words=False, break_on_hyphens=False)
    return "\n+ ".join(pieces)
