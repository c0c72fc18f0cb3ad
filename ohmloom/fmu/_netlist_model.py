"""The C text of a netlist's FMU: its laws, its tables, and what the runtime asks of a model."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from ohmloom.devices import LAWS, Device
from ohmloom.devices.laws._law import ORDERED
from ohmloom.fmu._law_code import PARTIALS
from ohmloom.fmu._netlist_code import Circuit
from ohmloom.fmu._tables import array, variable_table
from ohmloom.fmu.description import Description

STATES, VOLTAGES = (0.0, 0.37, 1.0), (-0.9, -1e-3, 0.2, 0.6)  # where conductances are compared with those at 0 V


def netlist_model(circuit: Circuit, description: Description, outputs: list[tuple[str, int]]) -> str:
    """``model.c``: tables, and what the runtime asks of a model."""
    cards, places = circuit.cards, circuit.places
    widths = [len(LAWS[card.law].parameters) for card in cards]
    at = [sum(widths[:k]) for k in range(len(cards))]
    kinds = [cards.index(card) for card in (m.device for m in circuit.memristors)] if len(cards) > 1 else (
        [0] * len(circuit.memristors))  # fmt: skip
    count = len(circuit.memristors)
    dispatch = []
    for function, arguments in (("conductance", "sv"), ("charge_rate", "svi"), *PARTIALS.items()):
        heads, calls = (", ".join(text.format(a) for a in arguments) for text in ("double {}", "{}"))
        dispatch += [f"static double {function}(int kind, {heads}, const double *p)", "{", "    switch (kind) {"]
        for k, card in enumerate(cards):
            case = "default:" if k == len(cards) - 1 else f"case {k}:"
            dispatch += [f"    {case}", f"        return {card.law}_{function}({calls}, p + {at[k]});"]
        dispatch += ["    }", "}", ""]
    checks = []
    for k, card in enumerate(cards):
        names = LAWS[card.law].parameter_names
        for low, high in ORDERED:
            if {low, high} <= set(names):
                checks += [f"    if (!(p[{at[k] + names.index(low)}] < p[{at[k] + names.index(high)}]))",
                           f'        return "{low}: expected {low} < {high}";']  # fmt: skip
    constants = [f"    c[{k}] = {card.law}_charge_scale(p + {at[k]});" for k, card in enumerate(cards)]

    def nodes(name: str, elements: Iterable[Any]) -> list[str]:
        listed = list(elements)
        return [array("int", f"{name}_{end}", [places[getattr(e, end)] for e in listed]) for end in "pn"]

    tables = [
        *nodes("device", circuit.memristors),
        array("int", "device_kind", kinds),
        *nodes("resistor", circuit.resistors),
        array("double", "resistor_g", [1.0 / e.resistance for e in circuit.resistors], "conductances in S"),
        array("double", "held_sign", circuit.signs, "of voltage sources, then capacitors: -1 with p at ground"),
        array("double", "capacitance", [e.capacitance for e in circuit.capacitors], "F"),
        *nodes("current", circuit.currents),
        array("int", "link_to", [to for to, _, _ in circuit.links], "of sources that are controlled or float"),
        array("int", "link_from", [of for _, of, _ in circuit.links]),
        array("double", "link_share", [float(share) for _, _, share in circuit.links]),
        "enum { POTENTIAL, HELD, SENSE, CURRENT }; /* kinds of output, and what a place then numbers: nodes, "
        "sources and capacitors, sources, devices */",
        array("int", "output_kind", [kind for kind, _ in outputs]),
        array("int", "output_place", [place for _, place in outputs]),
        array("int", "capacitor_kind", [kind for kind, _ in circuit.charging], "where its current stands, likewise"),
        array("int", "capacitor_place", [place for _, place in circuit.charging]),
    ]
    values = {
        "n_p": sum(widths) + count + len(circuit.capacitors), "q0": sum(widths),
        "n_u": len(circuit.sources) + len(circuit.currents), "n_x": count + len(circuit.capacitors), "devices": count,
        "capacitors": len(circuit.capacitors),
        "n_y": len(outputs), "n_c": len(cards), "free": circuit.free, "band": circuit.band,
        "sources": len(circuit.sources), "currents": len(circuit.currents), "resistors": len(circuit.resistors),
        "links": len(circuit.links), "general": int(bool(circuit.links)),
        "ohmic": int(all(map(is_ohmic, cards))), "tables": "\n".join(tables), "dispatch": "\n".join(dispatch),
        "variables": variable_table(description), "checks": "\n".join(checks), "constants": "\n".join(constants),
    }  # fmt: skip
    text = _MODEL
    for name, value in values.items():
        text = text.replace(f"@{name}@", str(value))
    return text


def is_ohmic(card: Device) -> bool:
    """Whether a card's conductance is the same at every voltage."""
    return all(card.conductance(s, v) == card.conductance(s) for s in STATES for v in VOLTAGES)


_MODEL = """/*
 * A circuit: sources in; charges, potentials and currents out. p: the cards' parameters, then the charges and the
 * capacitors' voltages at the start; c: the charge scale of each card.
 */
#include "law.c"

enum { N_P = @n_p@, N_U = @n_u@, N_X = @n_x@, N_LIMITED = @devices@, N_Y = @n_y@, N_C = @n_c@, FIRST_Q0 = @q0@ };
enum { N_FREE = @free@, BAND = @band@, N_SOURCES = @sources@, N_CURRENTS = @currents@, N_DEVICES = @devices@,
       N_CAPACITORS = @capacitors@, N_RESISTORS = @resistors@, N_LINKS = @links@, IS_OHMIC = @ohmic@ };
#define IS_GENERAL @general@

@tables@

@dispatch@
#include "netlist.c"

@variables@

static const char *model_check(const double *p, int is_starting)
{
    double c[N_C];
    int k;
@checks@
@constants@
    for (k = 0; is_starting && k < N_DEVICES; k++)
        if (p[FIRST_Q0 + k] > c[device_kind[k]] * (1.0 + 1e-12)) /* but for rounding */
            return "charge at the start: expected at most the charge q_d at which the state is 1";
    return NULL;
}

static void model_constants(const double *p, double *c)
{
@constants@
}

static void model_limits(const double *p, const double *c, double *low, double *high)
{
    int k;
    (void)p;
    for (k = 0; k < N_X; k++) {
        low[k] = k < N_DEVICES ? 0.0 : -INFINITY;
        high[k] = k < N_DEVICES ? c[device_kind[k]] : INFINITY;
    }
}

static void model_start(const double *p, const double *c, double *x)
{
    int k;
    for (k = 0; k < N_X; k++)
        x[k] = k < N_DEVICES ? fmin(p[FIRST_Q0 + k], c[device_kind[k]]) : p[FIRST_Q0 + k];
}

static void model_rates(const double *p, const double *c, const double *u, const double *x, double *rates)
{
    netlist_rates(p, c, u, x, rates);
}

static void model_outputs(const double *p, const double *c, const double *u, const double *x, double *y)
{
    netlist_outputs(p, c, u, x, y);
}

static void model_forward(const double *p, const double *c, const double *u, const double *x, const double *du,
                          const double *dx, double *drates, double *dy)
{
    netlist_forward(p, c, u, x, du, dx, drates, dy);
}

static void model_adjoint(const double *p, const double *c, const double *u, const double *x, const double *drates,
                          const double *dy, double *du, double *dx)
{
    netlist_adjoint(p, c, u, x, drates, dy, du, dx);
}
"""
