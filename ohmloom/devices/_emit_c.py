"""C99 with no dependency but math.h: one function for each question that a simulator asks a law."""

from __future__ import annotations

from ohmloom.devices._symbolic import Assignment, Dialect, trace, wrapped, write
from ohmloom.devices.laws import Law
from ohmloom.devices.laws._law import Rounds

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
        *emit_function(law, f"double {name}_", "conductance", ("s", "v")),
        "",
        "/* i in A, positive into the first terminal. */",
        f"double {name}_current({states}, const double *p)",
        "{",
        f"    return {name}_conductance(s, v, p) * v;",
        "}",
        "",
        "/* dq/dt in A, before walls. */",
        *emit_function(law, f"double {name}_", "charge_rate", ("s", "v", "i")),
        "",
        "/* q_d in C: the state charge between the walls. */",
        *emit_function(law, f"double {name}_", "charge_scale", ()),
        "",
        "/* ds/dt in 1/s; 0 where it points outward at a wall. */",
        f"double {name}_state_rate({states}, const double *p)",
        "{",
        f"    const double rate = {name}_charge_rate(s, v, {name}_current(s, v, p), p) / {name}_charge_scale(p);",
        "    return (s >= 1.0 && rate > 0.0) || (s <= 0.0 && rate < 0.0) ? 0.0 : rate;",
        "}",
    ]
    return "\n".join(lines) + "\n"


def emit_function(law: Law, prefix: str, wanted: str, arguments: tuple[str, ...]) -> list[str]:
    """Lines of the C function that gives what `trace` calls `wanted`; its name is that after `prefix`."""
    if wanted == "conductance" and law.rounds is not None:
        return _loop(law, prefix, law.rounds)
    reading, steps = _body(law, (wanted,), arguments, prefix)
    *steps, result = steps
    head = _head(f"{prefix}{wanted}", arguments)
    return [head, "{", *reading, *map(_constant, steps), wrapped(f"return {result.text};", 4), "}"]


def _head(name: str, arguments: tuple[str, ...]) -> str:
    return f"{name}({', '.join([*(f'double {argument}' for argument in arguments), 'const double *p'])})"


def _loop(law: Law, prefix: str, rounds: Rounds) -> list[str]:
    """A conductance that is found in rounds: its parts, and the loop over them."""
    own = f"static {prefix.removeprefix('static ')}conductance_"
    name = own.split()[-1]
    parts = {"start": ("s", "v"), "advance": ("u", "s", "v"), "finish": ("u", "s", "v")}
    lines = [line for part, arguments in parts.items() for line in (*emit_function(law, own, part, arguments), "")]
    return [
        *lines,
        _head(f"{prefix}conductance", ("s", "v")),
        "{",
        f"    double u = {name}start(s, v, p);",
        "    int k;",
        f"    for (k = 0; k < {rounds.count}; k++)",
        f"        u = {name}advance(u, s, v, p);",
        f"    return {name}finish(u, s, v, p);",
        "}",
    ]


def emit_together(law: Law, head: str, wanted: tuple[str, ...], arguments: tuple[str, ...]) -> list[str]:
    """Lines of the C function `head` that writes all that is `wanted` to the array `by`."""
    reading, steps = _body(law, wanted, arguments, f"{law.name}_")
    written = [f"    by[{k}] = {name};" for k, name in enumerate(wanted)]
    return [head, "{", *reading, *map(_constant, steps), *written, "}"]


def _constant(step: Assignment) -> str:
    return wrapped(f"const double {step.name} = {step.text};", 4)


def _body(
    law: Law, wanted: tuple[str, ...], arguments: tuple[str, ...], prefix: str
) -> tuple[list[str], list[Assignment]]:
    """Lines that read the parameters, and the assignments that end in what is wanted."""
    program = trace(law, *wanted)
    used = program.symbols
    read = [
        f"    const double {parameter} = p[{k}];"
        for k, parameter in enumerate(law.parameter_names)
        if parameter in used
    ]
    if "g" in used:
        read.append(f"    const double g = {prefix.split()[-1]}conductance(s, v, p);")
        used |= {"s", "v"}
    unused = [argument for argument in arguments if argument not in used] + ([] if read else ["p"])
    return [*(f"    (void){argument};" for argument in unused), *read], write(program, C)
