"""C99 with no dependency but math.h: one function for each question that a simulator asks a law."""

from __future__ import annotations

from ohmloom.devices._symbolic import Dialect, trace, wrapped, write
from ohmloom.devices.laws import Law

C = Dialect(functions={})


def emit_c(name: str, header: list[str], law: Law, values: tuple[float, ...]) -> str:
    """The text of a C file; every function takes the parameters `p` in declared order."""
    states, count = "double s, double v", len(values)
    head = [line for text in header for line in [f" * {text}".rstrip()]]
    table = [
        f"    {value!r}{',' if k < count - 1 else ' '} /* p[{k}]: {parameter.name} [{parameter.unit}] */"
        for k, (parameter, value) in enumerate(zip(law.parameters, values, strict=True))
    ]
    lines = [
        "/*",
        *head,
        " *",
        " * The functions take the parameters in the order of the array below.",
        " */",
        "#include <math.h>",
        "",
        f"const double {name}_parameters[{count}] = {{",
        *table,
        "};",
        "",
        "/* G(s, v) in S. */",
        *emit_function(law, f"double {name}_conductance", "conductance", ("s", "v")),
        "",
        "/* i in A, positive into the first terminal. */",
        f"double {name}_current({states}, const double *p)",
        "{",
        f"    return {name}_conductance(s, v, p) * v;",
        "}",
        "",
        "/* dq/dt in A, before walls. */",
        *emit_function(law, f"double {name}_charge_rate", "charge_rate", ("s", "v", "i")),
        "",
        "/* q_d in C: the state charge between the walls. */",
        *emit_function(law, f"double {name}_charge_scale", "charge_scale", ()),
        "",
        "/* ds/dt in 1/s; 0 where it points outward at a wall. */",
        f"double {name}_state_rate({states}, const double *p)",
        "{",
        f"    const double rate = {name}_charge_rate(s, v, {name}_current(s, v, p), p) / {name}_charge_scale(p);",
        "    return (s >= 1.0 && rate > 0.0) || (s <= 0.0 && rate < 0.0) ? 0.0 : rate;",
        "}",
    ]
    return "\n".join(lines) + "\n"


def emit_function(law: Law, head: str, wanted: str, arguments: tuple[str, ...]) -> list[str]:
    """Lines of the C function that begins with `head` and gives what `trace` calls `wanted`."""
    program = trace(law, wanted)
    used = program.symbols
    read = [
        f"    const double {parameter} = p[{k}];"
        for k, parameter in enumerate(law.parameter_names)
        if parameter in used
    ]
    unused = [argument for argument in arguments if argument not in used] + ([] if read else ["p"])
    *steps, result = write(program, C)
    return [
        f"{head}({', '.join([*(f'double {argument}' for argument in arguments), 'const double *p'])})",
        "{",
        *(f"    (void){argument};" for argument in unused),
        *read,
        *(wrapped(f"const double {step.name} = {step.text};", 4) for step in steps),
        wrapped(f"return {result.text};", 4),
        "}",
    ]
