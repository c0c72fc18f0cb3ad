"""A crossbar of memristors, or any netlist of resistors, memristors and sources, as one flattened FMU."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from ohmloom.circuits import MemristorCrossbar, Netlist, PulseTrain, memristor_netlist
from ohmloom.circuits._topology import check_topology
from ohmloom.circuits.elements import VoltageSource
from ohmloom.devices.emit import identifier
from ohmloom.errors import expect_type
from ohmloom.fmu._compile import Platforms
from ohmloom.fmu._netlist_code import analyse, netlist_description
from ohmloom.fmu._netlist_model import law_text, netlist_model
from ohmloom.fmu.build import Export, build, check_options
from ohmloom.fmu.description import FmiVersion
from ohmloom.fmu.discrete import LICENCE, runtime_file


def export_crossbar(
    circuit: MemristorCrossbar | Netlist,
    out: Path | str,
    *,
    fmi: FmiVersion = 2,
    platforms: Platforms = "host",
) -> Export:
    """Write memristors with the wires between them as one FMU, for model exchange and co-simulation.

    The potentials of all nodes are solved for inside, so that no algebraic loop is left to a master. In: the voltage of
    each voltage source, which has one end at ground, and the current of each current source; waveforms are left to the
    importer, and give the start values. Out: the charge of each memristor, its state, which stops at 0 and at its q_d;
    and of a netlist the node potentials and the currents of voltage sources and memristors. Parameters: those of the
    cards, tunable, and the charges at the start.

    A crossbar's inputs are ``v_row_I`` and ``v_column_J`` (what the sense holds, 0 by default), its outputs
    ``i_column_J``, positive into the sense, and ``q_I_J``.

    Parameters
    ----------
    circuit
        A crossbar, or a netlist of resistors, memristors and sources; one that `memristor_netlist` made is a crossbar.
    out, fmi, platforms
        As `export_device` has them.

    Raises
    ------
    ParameterError
        If an option is none of these, an element of another kind, or a node floats.
    OperationError
        If the compiler fails, or the file cannot be written.
    """
    where = "export_crossbar"
    expect_type(f"{where}: circuit", circuit, MemristorCrossbar, Netlist)
    path = check_options(where, out, fmi, platforms)
    netlist = _written_out(circuit) if isinstance(circuit, MemristorCrossbar) else circuit
    check_topology(netlist.flat, is_dc=True)
    sources = [e for e in netlist.flat if isinstance(e, VoltageSource)]
    is_crossbar = netlist.name == "crossbar" and all(re.fullmatch(r"[VH]_\d+", source.name) for source in sources)
    found = analyse(where, netlist.flat, netlist.nodes, is_crossbar=is_crossbar)
    description, outputs = netlist_description(netlist.name, identifier(netlist.name), found)
    model = {
        "law.c": law_text(found.cards),
        "model.c": netlist_model(found, description, outputs),
        "netlist.c": runtime_file("netlist.c"),
    }
    paragraphs = [
        f"{len(found.memristors)} memristors, {len(found.resistors)} resistors, {len(found.sources)} voltage sources, "
        f"{found.free} nodes whose potentials are solved for.",
        "i = G(s, v) v and dq/dt = charge rate(s, v, i) for each memristor, s = q/q_d in [0, 1]; Kirchhoff's current "
        "law at each node. See sources/netlist.c, and sources/law.c for the laws.",
        *(f"Card {card.name}: {card.law}, {card.source} (sha256 {card.sha256})." for card in found.cards),
        LICENCE,
    ]
    return build(path, description, model, paragraphs, fmi=fmi, platforms=platforms)


def _written_out(array: MemristorCrossbar) -> Netlist:
    rows, columns = array.s.shape
    rest = PulseTrain(t=np.array([0.0, 1.0]), v_row=np.zeros((2, rows)), v_column=np.zeros((2, columns)))
    return memristor_netlist(array, rest)
