"""A crossbar of memristors, or any netlist, as one flattened FMU."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from ohmloom.circuits import MemristorCrossbar, Netlist, PulseTrain, memristor_netlist
from ohmloom.circuits._topology import check_topology
from ohmloom.circuits.elements import GROUND, VCCS, VCVS, Capacitor, Memristor, Resistor, Simple, VoltageSource
from ohmloom.devices.emit import identifier
from ohmloom.errors import ParameterError, UnknownNameError, expect_type
from ohmloom.fmu._compile import Platforms
from ohmloom.fmu._law_code import law_text
from ohmloom.fmu._netlist_code import analyse, netlist_description, with_arrays
from ohmloom.fmu._netlist_model import netlist_model
from ohmloom.fmu.build import Export, build, check_options
from ohmloom.fmu.description import FmiVersion
from ohmloom.fmu.discrete import LICENCE, runtime_file
from ohmloom.mapping.grid import PARTNER, REFERENCE, SYNAPSE, tile_grid
from ohmloom.mapping.plan import Plan


def export_crossbar(
    circuit: MemristorCrossbar | Netlist,
    out: Path | str,
    *,
    fmi: FmiVersion = 2,
    platforms: Platforms = "host",
    arrays: bool = False,
) -> Export:
    """Write memristors with the wires between them as one FMU, for model exchange and co-simulation.

    The potentials of all nodes are solved for inside, so that no algebraic loop is left to a master. In: the voltage of
    each voltage source and the current of each current source; waveforms are left to the importer, and give the start
    values. Out: the charge of each memristor, its state, which stops at 0 and at its q_d; the voltage of each
    capacitor, a state as well; and of a netlist the node potentials and the currents of voltage sources, capacitors and
    memristors. Parameters: those of the cards, tunable, and charges and voltages at the start.

    A crossbar's inputs are ``v_row_I`` and ``v_column_J`` (what the sense holds, 0 by default), its outputs
    ``i_column_J``, positive into the sense, and ``q_I_J``.

    Parameters
    ----------
    circuit
        A crossbar, or a netlist; one that `memristor_netlist` made, without capacitors, is a crossbar.
    out, fmi, platforms
        As `export_device` has them.
    arrays
        Of a crossbar by FMI 3.0: the inputs as the arrays ``v_row[I]`` and ``v_column[J]``, the outputs
        ``i_column[J]``, the charges ``q[I][J]`` and those at the start ``q0[I][J]``; with open crosspoints ``q[K]`` and
        ``q0[K]``, row by row. Several tools do not read arrays.

    Raises
    ------
    ParameterError
        If an option is none of these, `arrays` is asked of FMI 2.0 or of what is no crossbar, there is no memristor, a
        node floats, or a loop of capacitors and voltage sources leaves one of them no voltage of its own.
    OperationError
        If the compiler fails, or the file cannot be written.
    """
    where = "export_crossbar"
    expect_type(f"{where}: circuit", circuit, MemristorCrossbar, Netlist)
    path = check_options(where, out, fmi, platforms, arrays=arrays)
    netlist = _written_out(circuit) if isinstance(circuit, MemristorCrossbar) else circuit
    check_topology(netlist.flat, is_dc=False)
    is_crossbar = _is_crossbar(netlist)
    found = analyse(where, netlist.flat, netlist.nodes, is_crossbar=is_crossbar)
    if any(isinstance(e, VCVS | VCCS) for e in netlist.flat):
        _charged(netlist).dc()  # which names the sources that leave no or more than one solution
    description, outputs = netlist_description(netlist.name, identifier(netlist.name), found)
    if arrays:
        if not is_crossbar:
            raise ParameterError(f"{where}: arrays: expected a crossbar, whose lines make arrays, got the netlist "
                                 f"{netlist.name}. Leave arrays out.")  # fmt: skip
        description = with_arrays(description)
    model = {
        "law.c": law_text(card.law for card in found.cards),
        "model.c": netlist_model(found, description, outputs),
        "netlist.c": runtime_file("netlist.c"),
    }
    paragraphs = [
        f"{len(found.memristors)} memristors, {len(found.resistors)} resistors, {len(found.capacitors)} capacitors, "
        f"{len(found.sources)} voltage sources, {found.free} nodes whose potentials are solved for.",
        "i = G(s, v) v and dq/dt = charge rate(s, v, i) for each memristor, s = q/q_d in [0, 1]; Kirchhoff's current "
        "law at each node. See sources/fmu.c, parts netlist.c and law.c.",
        *(f"Card {card.name}: {card.law}, {card.source} (sha256 {card.sha256})." for card in found.cards),
        LICENCE,
    ]
    return build(path, description, model, paragraphs, fmi=fmi, platforms=platforms)


def tile_circuit(plan: Plan, tile: int) -> Netlist:
    """A tile of a plan as a crossbar of its devices at the start of a trial, with the spec's wires.

    Synapses are devices of the tile's card at their states; partners, references and what is present without a synapse
    devices at s = 0; unformed crosspoints resistors; masked ones are left out.
    """
    grid = tile_grid(plan, tile)
    made, wires = plan.tiles[tile], plan.hardware.wires.resistances
    states = {point.synapse: point.state for point in plan.crosspoints}
    s, kind = np.zeros(grid.conductance.shape), np.full(grid.conductance.shape, -1)
    unformed = {}
    is_present = plan.hardware.array.disabled == "present"
    for (i, j), cell in np.ndenumerate(grid.cell):
        if grid.conductance[i, j] > 0.0:
            if cell in (SYNAPSE, PARTNER, REFERENCE) or is_present:
                kind[i, j] = 0
                s[i, j] = states[int(grid.synapse[i, j])] if cell == SYNAPSE else 0.0
            else:
                unformed[i, j] = float(grid.conductance[i, j])
    array = MemristorCrossbar(devices=plan.hardware.devices[made.kind], s=s, kind=kind, r_row=wires["r_row"],
                              r_column=wires["r_column"], r_driver=wires["r_driver"],
                              r_sense=wires["r_sense"])  # fmt: skip
    netlist = _written_out(array)
    rows, columns = (f"row_{{0}}{'_{1}' if array.r_row else ''}", f"column_{'{0}_' if array.r_column else ''}{{1}}")
    cells = [
        Resistor(name=f"N_{i}_{j}", p=rows.format(i, j), n=columns.format(i, j), resistance=1.0 / g)
        for (i, j), g in unformed.items()
    ]
    return replace(netlist, elements=(*netlist.elements, *cells))


def choose_tile(plan: Plan, name: str | None) -> int:
    """Index of the tile that `name` is the index or the kind of; of the only one if it is None.

    Raises
    ------
    UnknownNameError, ParameterError
        If there is none, or several; names all.
    """
    if name is None and len(plan.tiles) == 1:
        return 0
    listed = ", ".join(f"{k} ({tile.name})" for k, tile in enumerate(plan.tiles))
    if name is None:
        raise ParameterError(f"tile: expected one of {listed}, got none. Name its number or its kind.")
    found = [k for k, tile in enumerate(plan.tiles) if name in (str(k), tile.kind, tile.name)]
    if not found:
        raise UnknownNameError.of("tile", name, [str(k) for k in range(len(plan.tiles))] + [t.kind for t in plan.tiles])
    if len(found) > 1:
        raise ParameterError(f"tile: expected one of {listed}, got {name!r}, which is several. Name its number.")
    return found[0]


def _is_crossbar(netlist: Netlist) -> bool:
    """Whether it is built and named as `memristor_netlist` does it, so that its variables can be named by line."""

    def belongs(e: Simple) -> bool:
        if isinstance(e, VoltageSource):
            return bool(re.fullmatch(r"[VH]_\d+", e.name)) and GROUND in (e.p, e.n)
        return isinstance(e, Resistor) or (isinstance(e, Memristor) and bool(re.fullmatch(r"D_\d+_\d+", e.name)))

    return netlist.name == "crossbar" and all(map(belongs, netlist.flat))


def _charged(netlist: Netlist) -> Netlist:
    """The circuit that is solved for at every moment: capacitors hold their voltages, as sources do."""
    return Netlist(name=netlist.name, elements=tuple(
        VoltageSource(name=e.name, p=e.p, n=e.n, voltage=e.initial) if isinstance(e, Capacitor) else e
        for e in netlist.flat
    ))  # fmt: skip


def _written_out(array: MemristorCrossbar) -> Netlist:
    rows, columns = array.s.shape
    rest = PulseTrain(t=np.array([0.0, 1.0]), v_row=np.zeros((2, rows)), v_column=np.zeros((2, columns)))
    return memristor_netlist(array, rest)
