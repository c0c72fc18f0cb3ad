"""A Verilog-A module: the state is the voltage of an internal node, its rate a contribution beside `ddt`."""

from __future__ import annotations

import math
import textwrap

from ohmloom.devices._emit_spice import OVERSHOOT, WALL
from ohmloom.devices._symbolic import WIDTH, Dialect, trace, wrapped, write
from ohmloom.devices.laws import Law, Parameter

VERILOG_A = Dialect(functions={"log": "ln({})", "fabs": "abs({})", "fmin": "min({})", "fmax": "max({})"})


def emit_verilog_a(name: str, header: list[str], law: Law, values: tuple[float, ...]) -> str:
    """The text of a Verilog-A file."""
    steps = write(trace(law, "charge_scale", "i", "rate"), VERILOG_A)
    temporaries = [step.name for step in steps if step.name not in ("charge_scale", "i", "rate")]
    parameters = [_parameter(parameter, value) for parameter, value in zip(law.parameters, values, strict=True)]
    lines = [
        *(f"// {text}".rstrip() for text in header),
        "//",
        "// Node x holds the state. s0 is its value wherever there is no time: at the start of a transient, in .op.",
        '`include "disciplines.vams"',
        "",
        f"module {name}(p, n);",
        "    inout p, n;",
        "    electrical p, n, x;",
        *parameters,
        '    (* desc = "state at the start", units = "1" *) parameter real s0 = 0.5 from [0:1];',
        '    (* desc = "state charge", units = "C" *) real q;',
        '    (* desc = "state", units = "1" *) real s;',
        "    real v, i, charge_scale, rate, inward;",
        *_declared(temporaries),
        "",
        "    analog begin",
        "        s = min(max(V(x), 0.0), 1.0);",
        "        v = V(p, n);",
        *(wrapped(f"{step.name} = {step.text};", 8) for step in steps),
        "        q = s * charge_scale;",
        f"        // An outward rate fades to 0 over the last {WALL!r} of s.",
        "        inward = rate > 0.0 ? 1.0 - V(x) : V(x);",
        f"        rate = rate * min(max(inward / {WALL!r}, inward / {OVERSHOOT!r}), 1.0);",
        "        I(p, n) <+ i;",
        '        if (analysis("static"))',
        "            V(x) <+ s0;",
        "        else",
        "            I(x) <+ ddt(V(x)) - rate;",
        "    end",
        "endmodule",
    ]
    return "\n".join(lines) + "\n"


def _parameter(parameter: Parameter, value: float) -> str:
    low = repr(float(parameter.lower)) if math.isfinite(parameter.lower) else "-inf"
    high = repr(float(parameter.upper)) if math.isfinite(parameter.upper) else "inf"
    opening, closing = "[("[low == "-inf"], "])"[high == "inf"]
    quoted = parameter.doc.replace("\\", "/").replace('"', "'")
    return (
        f'    (* desc = "{quoted}", units = "{parameter.unit}" *)\n'
        f"    parameter real {parameter.name} = {value!r} from {opening}{low}:{high}{closing};"
    )


def _declared(names: list[str]) -> list[str]:
    if not names:
        return []
    indent = "    "
    return textwrap.wrap(f"real {', '.join(names)};", WIDTH, initial_indent=indent, subsequent_indent=indent * 2)
