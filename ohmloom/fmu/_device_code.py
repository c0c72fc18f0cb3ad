"""The C text and the description of a device: its law, and what the runtime asks of a model."""

from __future__ import annotations

from ohmloom.devices import LAWS, Device
from ohmloom.devices._checks import LARGEST_VOLTAGE
from ohmloom.devices.emit import identifier
from ohmloom.devices.laws._law import ORDERED
from ohmloom.fmu._flux_code import FLOWS
from ohmloom.fmu._law_code import FUNCTIONS, law_text, partials_text
from ohmloom.fmu._tables import variable_table
from ohmloom.fmu.description import Description, Variable


def device_description(device: Device, q0: float) -> Description:
    """Variables of a device's FMU; dependencies from the structure of the law's expressions."""
    law, q_d = LAWS[device.law], device.charge_scale
    needs = _dependencies(device)
    parameters = tuple(
        Variable(name=p.name, kind="parameter", unit=p.unit, doc=p.doc, start=device.parameters[p.name], low=p.lower,
                 high=p.upper)
        for p in law.parameters
    )  # fmt: skip

    def calculated(name: str, unit: str, doc: str, of: str = "", nominal: float | None = None) -> Variable:
        found = needs[of or name]
        at_start = {"q0" if need == "q" else need for need in found}
        return Variable(
            name=name, kind="rate" if of else "output", unit=unit, doc=doc, nominal=nominal, state="q" if of else "",
            dependencies=tuple(need for need in found if need in ("v", "q")), initial_dependencies=tuple(at_start),
        )  # fmt: skip

    rate = calculated("der(q)", "A", "rate of the state charge, 0 where q rests at a limit", of="rate")
    return Description(
        name=device.name,
        identifier=identifier(device.name),
        doc=f"Memristor {device.name}: {law.doc}",
        stop_time=1.0,
        step_size=0.01,
        variables=(
            *parameters,
            Variable(name="q0", kind="start", unit="C", doc="charge at the start, from 0 to q_d", start=q0, low=0.0,
                     high=1e300),
            Variable(name="v", kind="input", unit="V", doc="voltage of the first terminal above the second",
                     low=-LARGEST_VOLTAGE, high=LARGEST_VOLTAGE),
            Variable(name="q", kind="state", unit="C", doc="state charge, from 0 to q_d", nominal=q_d,
                     dependencies=("q",), initial_dependencies=("q0",)),
            rate,
            calculated("i", "A", "current, positive into the first terminal"),
            calculated("memristance", "Ohm", "1/G at vanishing voltage", nominal=1.0 / device.conductance(0.5)),
            calculated("weight", "1", "G/G_on at vanishing voltage"),
            Variable(name="q_above_low", kind="indicator", unit="1", doc="positive until q reaches or leaves 0",
                     dependencies=("v", "q")),
            Variable(name="q_below_high", kind="indicator", unit="1", doc="positive until q reaches or leaves q_d",
                     dependencies=("v", "q")),
        ),
    )  # fmt: skip


def device_code(device: Device, description: Description) -> dict[str, str]:
    """``law.c`` and ``model.c``."""
    law = LAWS[device.law]
    checks = [
        f"    if (!(p[{law.parameter_names.index(low)}] < p[{law.parameter_names.index(high)}]))\n"
        f'        return "{low}: expected {low} < {high}";'
        for low, high in ORDERED
        if {low, high} <= set(law.parameter_names)
    ]
    n = len(law.parameters)
    values = {"variables": variable_table(description), "checks": "\n".join(checks), "partials": partials_text(law),
              "n_p": str(n + 1), "q0": str(n)}  # fmt: skip
    flow = FLOWS.get(law.name, "")
    text = (_MODEL + (_FLOW.replace("@flow@", flow) if flow else "")).replace("law_", f"{law.name}_")
    for name, value in values.items():
        text = text.replace(f"@{name}@", value)
    return {"law.c": law_text([law.name], FUNCTIONS), "model.c": text}


def _dependencies(device: Device) -> dict[str, tuple[str, ...]]:
    """For each result the names among v, q and the parameters that it depends on."""
    import casadi

    law = LAWS[device.law]
    names = ("v", "q", *law.parameter_names)
    symbols = [casadi.SX.sym(name) for name in names]
    v, q, *p = symbols
    s = q / law.charge_scale(p)
    g, weak = law.conductance(s, v, p), law.conductance(s, 0.0, p)
    results = {
        "rate": law.charge_rate(s, v, g * v, p),
        "i": g * v,
        "memristance": 1.0 / weak,
        "weight": weak / law.conductance(1.0, 0.0, p),
    }
    return {
        result: tuple(name for name, x in zip(names, symbols, strict=True) if casadi.depends_on(casadi.SX(value), x))
        for result, value in results.items()
    }


_MODEL = """/*
 * One memristor: charge q in [0, q_d], voltage v in; current, memristance and weight out.
 * p: the law's parameters, then q0; c: q_d, G(1, 0).
 */
#include "law.c"

enum { N_P = @n_p@, N_U = 1, N_X = 1, N_LIMITED = 1, N_Y = 3, N_C = 2 };

@variables@

static const char *model_check(const double *p, int is_starting)
{
@checks@
    /* The largest charge, but for rounding. */
    if (is_starting && p[@q0@] > law_charge_scale(p) * (1.0 + 1e-12))
        return "q0: expected at most the charge q_d at which the state is 1";
    return NULL;
}

static void model_constants(const double *p, double *c)
{
    c[0] = law_charge_scale(p);
    c[1] = law_conductance(1.0, 0.0, p);
}

static void model_limits(const double *p, const double *c, double *low, double *high)
{
    (void)p;
    low[0] = 0.0;
    high[0] = c[0];
}

static void model_start(const double *p, const double *c, double *x) { x[0] = fmin(p[@q0@], c[0]); }

static void model_rates(const double *p, const double *c, const double *u, const double *x, double *rates)
{
    const double s = x[0] / c[0], v = u[0];
    rates[0] = law_charge_rate(s, v, law_conductance(s, v, p) * v, p);
}

static void model_outputs(const double *p, const double *c, const double *u, const double *x, double *y)
{
    const double s = x[0] / c[0], g = law_conductance(s, 0.0, p);
    y[0] = law_conductance(s, u[0], p) * u[0];
    y[1] = 1.0 / g;
    y[2] = g / c[1];
}
@partials@

/* Of rate, i, memristance and weight, by v and by q. */
SELDOM static void model_partials(const double *p, const double *c, const double *u, const double *x, double d[4][2])
{
    const double s = x[0] / c[0], v = u[0], g = law_conductance(s, v, p), weak = law_conductance(s, 0.0, p);
    double at_rest[5], by[5]; /* conductance by s and v, charge rate by s, v and i */
    law_partials(s, 0.0, 0.0, p, at_rest);
    law_partials(s, v, g * v, p, by);
    d[1][0] = g + by[1] * v;
    d[1][1] = by[0] * v / c[0];
    d[0][0] = by[3] + by[4] * d[1][0];
    d[0][1] = by[2] / c[0] + by[4] * d[1][1];
    d[2][0] = d[3][0] = 0.0;
    d[2][1] = -at_rest[0] / (weak * weak) / c[0];
    d[3][1] = at_rest[0] / c[1] / c[0];
}

static void model_forward(const double *p, const double *c, const double *u, const double *x, const double *du,
                          const double *dx, double *drates, double *dy)
{
    double d[4][2];
    int k;
    model_partials(p, c, u, x, d);
    drates[0] = d[0][0] * du[0] + d[0][1] * dx[0];
    for (k = 0; k < N_Y; k++)
        dy[k] = d[k + 1][0] * du[0] + d[k + 1][1] * dx[0];
}

static void model_adjoint(const double *p, const double *c, const double *u, const double *x, const double *drates,
                          const double *dy, double *du, double *dx)
{
    double d[4][2];
    int k;
    model_partials(p, c, u, x, d);
    du[0] += d[0][0] * drates[0];
    dx[0] += d[0][1] * drates[0];
    for (k = 0; k < N_Y; k++) {
        du[0] += d[k + 1][0] * dy[k];
        dx[0] += d[k + 1][1] * dy[k];
    }
}
"""
_FLOW = """
@flow@
/* The state after a time in which the input is held, limits aside. */
static double model_flow(const double *p, const double *c, const double *u, const double *x, double duration)
{
    return x[0] + law_flow(x[0] / c[0], u[0] * duration, p);
}
"""
