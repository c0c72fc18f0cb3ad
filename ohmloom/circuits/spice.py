"""Netlists as ngspice decks, and ngspice's answer as a trace."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom._files import read_bytes, sha256, write_atomic
from ohmloom.circuits._raw_file import Plot, parse_raw
from ohmloom.circuits._topology import check_topology
from ohmloom.circuits.elements import (
    VCCS,
    VCVS,
    Capacitor,
    CurrentSource,
    Memristor,
    Resistor,
    Simple,
    VoltageSource,
)
from ohmloom.circuits.netlist import Netlist
from ohmloom.circuits.netlist_trace import NetlistTrace
from ohmloom.circuits.waveforms import Waveform
from ohmloom.devices import Device
from ohmloom.devices.emit import identifier
from ohmloom.errors import FileFormatError, OperationError, ParameterError, expect_number, expect_type

LETTERS: dict[type, str] = {
    Resistor: "R", Capacitor: "C", VoltageSource: "V", CurrentSource: "I", Memristor: "X", VCVS: "E", VCCS: "G"
}  # fmt: skip
# Of the duration, as the longest step: ngspice's own error control looks only at capacitors.
STEPS = 1000
# Absolute tolerances as shares of the relative one at 1e-6: A, V and C well below what memristors carry.
ABSTOL, VNTOL, CHGTOL = 1e-15, 1e-10, 1e-18
# In messages of ngspice that end an analysis.
_BAD = re.compile(r"error|fatal|singular|too small|aborted|no convergence|failed|can't|cannot", re.IGNORECASE)


def deck(
    netlist: Netlist, *, t_end: float | None = None, max_step: float | None = None, relative_tolerance: float = 1e-6
) -> str:
    """The netlist as text for ngspice: memristors as the subcircuits of their cards, with their states at t = 0.

    Parameters
    ----------
    t_end
        Duration of the transient [s], the netlist's own by default; without either, the operating point at t = 0.
    max_step
        Longest time step [s]; by default a thousandth of `t_end`.
    relative_tolerance
        ngspice's reltol.

    Raises
    ------
    ParameterError
        If nodes float, sources form a loop, or `max_step` is longer than an edge.
    """
    end = netlist.duration("Netlist.to_spice", t_end)
    check_topology(netlist.flat, is_dc=end is None)
    tolerance = expect_number("Netlist.to_spice: relative_tolerance", relative_tolerance, "a number in (0, 0.1]")
    if not 0.0 < tolerance <= 0.1:
        raise ParameterError(
            f"Netlist.to_spice: relative_tolerance: expected a number in (0, 0.1], got {tolerance:g}. Correct it."
        )
    names, subcircuits = _names(netlist.flat), _subcircuits(netlist.flat)
    lines = [f"* {netlist.name}: written by ohmloom {version('ohmloom')}"]
    lines += [_line(element, names[element.name], subcircuits, end or 0.0) for element in netlist.flat]
    for device, name in subcircuits.items():
        lines += ["", replace(device, name=name).emit("spice").rstrip()]
    lines += ["", f".options reltol={tolerance!r} abstol={ABSTOL!r} vntol={VNTOL!r} chgtol={CHGTOL!r} numdgt=15"]
    saved = list(_vectors(netlist, names))
    lines += [".save " + " ".join(saved[k : k + 6]) for k in range(0, len(saved), 6)]
    if end is None:
        # At DC the emitted state would go where its rate ends; a source on its inner node keeps it at s0.
        lines += [
            f"Vhold_{k} {names[m.name]}.x 0 {m.s0!r}" for k, m in enumerate(netlist.flat) if isinstance(m, Memristor)
        ]
        lines.append(".op")
    else:
        if max_step is None:
            step = min(end / STEPS, _shortest_edge(netlist))
        else:
            step = netlist.check_step("Netlist.to_spice", max_step)
        has_capacitors = any(isinstance(element, Capacitor) for element in netlist.flat)
        lines.append(f".tran {step!r} {end!r} 0 {step!r}{' uic' if has_capacitors else ''}")
    return "\n".join([*lines, ".end", ""])


def run_ngspice(
    netlist: Netlist | str,
    *,
    t_end: float | None = None,
    max_step: float | None = None,
    relative_tolerance: float = 1e-6,
    timeout: float = 60.0,
) -> NetlistTrace:
    """Run a netlist, or the text of a deck, by ``ngspice -b``; the trace has ngspice's own times.

    Of a deck, the trace has the saved node voltages and the currents of sources by ngspice's names, in lower case. An
    operating point is a trace of one time, 0.

    Parameters
    ----------
    t_end, max_step, relative_tolerance
        As for `Netlist.to_spice`; a deck has its own.
    timeout
        Longest run [s].

    Raises
    ------
    OperationError
        If ngspice is missing, fails, or takes too long; the message quotes it and names the deck, which is kept.
    FileFormatError
        If its raw file cannot be read.
    """
    expect_type("run_ngspice", netlist, Netlist, str, name="a Netlist or the text of a deck")
    limit = expect_number("run_ngspice: timeout", timeout, "a time in s")
    if isinstance(netlist, str):
        if t_end is not None or max_step is not None:
            raise ParameterError("run_ngspice: t_end: expected none beside the text of a deck, got one. Set it there.")
        text, end = netlist, None
    else:
        text = deck(netlist, t_end=t_end, max_step=max_step, relative_tolerance=relative_tolerance)
        end = netlist.duration("run_ngspice", t_end)
    plot, raw = _run(text, limit, end)
    times = plot.vectors.pop("time", None)
    t = np.zeros(1) if times is None else times
    made = {"ohmloom": version("ohmloom"), "engine": "ngspice", "deck_sha256": sha256(text.encode())}
    provenance = json.dumps(made, sort_keys=True)
    if isinstance(netlist, str):
        parts = {part: {name[2:-1]: values for name, values in plot.vectors.items() if name.startswith(f"{part}(")}
                 for part in ("v", "i")}  # fmt: skip
        return NetlistTrace(t=t, **parts, s={}, q={}, residual=0.0, provenance=provenance)
    return _trace(netlist, t, plot, raw, provenance)


def _names(elements: tuple[Simple, ...]) -> dict[str, str]:
    """ngspice's name of each element: its own, behind the letter of its kind where it does not begin with it."""
    names: dict[str, str] = {}
    taken = {f"vhold_{k}" for k in range(len(elements))}
    for element in elements:
        is_short = isinstance(element, Resistor) and element.resistance == 0.0
        letter = "V" if is_short else LETTERS[type(element)]
        name = element.name if element.name[0].upper() == letter else letter + element.name
        while name.lower() in taken:
            name += "_"
        taken.add(name.lower())
        names[element.name] = name
    return names


def _subcircuits(elements: tuple[Simple, ...]) -> dict[Device, str]:
    """One subcircuit per card; cards of one name that differ get numbers."""
    found: dict[Device, str] = {}
    taken: set[str] = set()
    for element in elements:
        if isinstance(element, Memristor) and element.device not in found:
            base = name = identifier(element.device.name)
            count = 1
            while name.lower() in taken:
                count += 1
                name = f"{base}_{count}"
            taken.add(name.lower())
            found[element.device] = name
    return found


def _line(element: Simple, name: str, subcircuits: Mapping[Device, str], t_end: float) -> str:
    head = f"{name} {element.p} {element.n}"
    if isinstance(element, Resistor):
        return f"{head} {element.resistance!r}" if element.resistance > 0.0 else f"{head} DC 0"
    if isinstance(element, Capacitor):
        return f"{head} {element.capacitance!r} ic={element.initial!r}"
    if isinstance(element, VCVS):
        return f"{head} {element.control_p} {element.control_n} {element.gain!r}"
    if isinstance(element, VCCS):
        return f"{head} {element.control_p} {element.control_n} {element.transconductance!r}"
    if isinstance(element, Memristor):
        return f"{head} {subcircuits[element.device]} s0={element.s0!r}"
    waveform = element.voltage if isinstance(element, VoltageSource) else element.current
    assert isinstance(waveform, Waveform)
    return f"{head} {waveform.to_spice(t_end)}"


def _vectors(netlist: Netlist, names: Mapping[str, str]) -> dict[str, None]:
    """What a deck saves: node voltages, currents of what fixes a voltage, and memristors' inner nodes."""
    saved = [f"v({node})" for node in netlist.nodes]
    for element in netlist.flat:
        name = names[element.name]
        if isinstance(element, Memristor):
            saved += [f"v({name}.{inner})" for inner in ("x", "q", "i")]
        elif isinstance(element, Capacitor):
            saved.append(f"@{name}[i]")
        elif name[0].upper() in "VE":
            saved.append(f"i({name})")
    return dict.fromkeys(text.lower() for text in saved)


def _trace(netlist: Netlist, t: FloatArray, plot: Plot, raw: str, provenance: str) -> NetlistTrace:
    names = _names(netlist.flat)
    wanted = [f"i({name})" if name.startswith("@") else name for name in _vectors(netlist, names)]
    missing = [name for name in wanted if name not in plot.vectors]
    if missing:
        raise FileFormatError(f"{raw}: expected the vector {missing[0]}, got none. Check the version of ngspice.")
    v = {node: plot.vectors[f"v({node.lower()})"] for node in netlist.nodes}
    potential = {"0": np.zeros(t.size), **v}
    i, s, q = {}, {}, {}
    for element in netlist.flat:
        name = names[element.name].lower()
        across = potential[element.p] - potential[element.n]
        if isinstance(element, Memristor):
            i[element.name] = plot.vectors[f"v({name}.i)"]
            # The emitted state may overshoot a wall by the tolerance.
            s[element.name] = np.clip(plot.vectors[f"v({name}.x)"], 0.0, 1.0)
            q[element.name] = plot.vectors[f"v({name}.q)"]
        elif isinstance(element, Capacitor):
            i[element.name] = plot.vectors[f"i(@{name}[i])"]
        elif isinstance(element, VCCS):
            i[element.name] = element.transconductance * (potential[element.control_p] - potential[element.control_n])
        elif isinstance(element, CurrentSource):
            waveform = element.current
            assert isinstance(waveform, Waveform)
            i[element.name] = np.array([waveform.value(time) for time in t.tolist()])
        elif isinstance(element, Resistor) and element.resistance > 0.0:
            i[element.name] = across / element.resistance
        else:
            i[element.name] = plot.vectors[f"i({name})"]
    return NetlistTrace(t=t, v=v, i=i, s=s, q=q, residual=_residual(netlist, i), provenance=provenance)


def _residual(netlist: Netlist, i: Mapping[str, FloatArray]) -> float:
    sums: dict[str, Any] = dict.fromkeys(netlist.nodes, 0.0)
    for element in netlist.flat:
        for node, sign in ((element.p, 1.0), (element.n, -1.0)):
            if node != "0":
                sums[node] = sums[node] + sign * i[element.name]
    largest = max((float(np.abs(current).max()) for current in i.values()), default=0.0)
    worst = max((float(np.abs(total).max()) for total in sums.values()), default=0.0)
    return worst / largest if largest > 0.0 else worst


def _shortest_edge(netlist: Netlist) -> float:
    waveforms: list[Any] = [getattr(e, "voltage", getattr(e, "current", None)) for e in netlist.flat]
    return min((w.shortest_edge() for w in waveforms if w is not None), default=np.inf)


def _run(text: str, timeout: float, t_end: float | None) -> tuple[Plot, str]:
    """The last plot, and the name of its file; on failure the deck stays where the error says."""
    program = shutil.which("ngspice")
    if program is None:
        raise OperationError("run_ngspice: expected ngspice on PATH, got none. Install it, or use Netlist.simulate.")
    folder = Path(tempfile.mkdtemp(prefix="ohmloom_ngspice_"))
    written, raw = folder / "deck.cir", folder / "out.raw"
    write_atomic(written, text)
    try:
        done = subprocess.run([program, "-n", "-b", "-r", raw.name, written.name], cwd=folder, capture_output=True,
                              timeout=timeout, check=False, stdin=subprocess.DEVNULL)  # fmt: skip
    except subprocess.TimeoutExpired as error:
        raise OperationError(f"{written}: expected ngspice to finish within {timeout:g} s, got no end. "
                             "Raise timeout, or max_step.") from error  # fmt: skip
    except OSError as error:
        raise OperationError(
            f"{program}: expected a program that runs, got {error.strerror}. Install it again."
        ) from error
    said = done.stderr.decode("utf-8", "replace") + "\n" + done.stdout.decode("utf-8", "replace")
    if done.returncode != 0 or not raw.exists():
        raise _failure(written, said)
    plots = parse_raw(read_bytes(raw, "raw", limit=None), str(raw))
    times = plots[-1].vectors.get("time")
    is_short = t_end is not None and (times is None or times.size == 0 or times[-1] < t_end * (1.0 - 1e-6))
    if is_short or not all(np.isfinite(values).all() for values in plots[-1].vectors.values()):
        raise _failure(written, said)
    shutil.rmtree(folder, ignore_errors=True)
    return plots[-1], str(raw)


def _failure(written: Path, said: str) -> OperationError:
    lines = [" ".join(line.split()) for line in said.splitlines() if line.strip()]
    bad = [line for line in lines if _BAD.search(line)]
    quoted = "; ".join((bad or lines)[:3])[:300] or "nothing"
    return OperationError(f"{written}: expected ngspice to finish, got '{quoted}'. Check the deck, which is kept.")
