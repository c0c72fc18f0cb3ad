"""Crossbars written out as netlists: every wire segment, device, driver and sense an element of its own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom.circuits.crossbar import Crossbar
from ohmloom.circuits.elements import Element, Memristor, Resistor, VoltageSource
from ohmloom.circuits.memristor_crossbar import MemristorCrossbar
from ohmloom.circuits.netlist import Netlist
from ohmloom.circuits.pulses import PulseTrain
from ohmloom.circuits.waveforms import PiecewiseLinear, Waveform
from ohmloom.errors import ParameterError, expect_type


def crossbar_netlist(crossbar: Crossbar, v: Any) -> Netlist:
    """A crossbar, with the voltages `v` [V], axes (word_line,), on its rows, as a netlist of resistors.

    Device (i, j) is ``D_i_j`` between ``row_i_j`` and ``column_i_j``; the current into the sense of column j is that of
    ``S_j`` (and of ``T_j`` at the far end). Wires without resistance are single nodes ``row_i``, ``column_j``; open
    devices are left out.

    Raises
    ------
    ParameterError
        If the crossbar is a batch or not ohmic, or `v` has other axes.
    """
    expect_type("crossbar_netlist", crossbar, Crossbar)
    if crossbar.conductance.ndim != 2:
        raise ParameterError(f"crossbar_netlist: expected one crossbar, axes (word_line, bit_line), got shape "
                             f"{crossbar.conductance.shape}. Take one of the batch.")  # fmt: skip
    if crossbar.conduction is not None:
        raise ParameterError(f"crossbar_netlist: expected ohmic devices, got {type(crossbar.conduction).__name__}. "
                             "replace(conduction=None) gives those at low field.")  # fmt: skip
    volts = np.asarray(v, dtype=np.float64)
    if volts.shape != crossbar.shape[:1] or not np.isfinite(volts).all():
        raise ParameterError(f"crossbar_netlist: v: expected finite voltages, axes (word_line={crossbar.shape[0]},), "
                             f"got shape {volts.shape}. Give one voltage per word line.")  # fmt: skip

    def resistor(i: int, j: int, p: str, n: str) -> Element | None:
        g = float(crossbar.conductance[i, j])
        return Resistor(name=f"D_{i}_{j}", p=p, n=n, resistance=1.0 / g) if g > 0.0 else None

    return Netlist(name="crossbar", elements=_written_out(crossbar, volts.tolist(), None, resistor))


def memristor_netlist(array: MemristorCrossbar, train: PulseTrain) -> Netlist:
    """Memristors in a crossbar, under a pulse train, as a netlist; ``to_spice`` makes its deck.

    Names are those of `crossbar_netlist`, the devices memristors at their states `s`; the sense of column j is held by
    ``H_j``.

    Raises
    ------
    ParameterError
        If the train has other lines, or does not begin at t = 0.

    Examples
    --------
    >>> from ohmloom.devices import Device
    >>> array = MemristorCrossbar(devices=Device.load("hp_tio2_10k"), s=[[0.5, 0.2]], r_row=1.0, r_column=1.0)
    >>> train = PulseTrain.rectangular([[1.0]], columns=2, width=1e-5, edge=1e-6, period=2e-5)
    >>> netlist = memristor_netlist(array, train)
    >>> trace = netlist.simulate(t=train.t)
    >>> bool(abs(trace.s["D_0_0"][-1] - array.simulate(train.t, train.v_row).s[-1, 0, 0]) < 1e-9)
    True
    """
    expect_type("memristor_netlist: array", array, MemristorCrossbar)
    expect_type("memristor_netlist: train", train, PulseTrain)
    assert array.kind is not None
    assert isinstance(array.devices, tuple)
    m, n = array.s.shape
    if (train.v_row.shape[1], train.v_column.shape[1]) != (m, n) or train.t[0] != 0.0:
        raise ParameterError(f"memristor_netlist: train: expected {m} rows and {n} columns from t = 0 on, got "
                             f"{train.v_row.shape[1]} and {train.v_column.shape[1]} from t = {train.t[0]:g} s. Make "
                             "it for this array.")  # fmt: skip
    cards, kinds = array.devices, array.kind

    def memristor(i: int, j: int, p: str, n: str) -> Element | None:
        kind = int(kinds[i, j])
        s0 = float(array.s[i, j])
        return Memristor(name=f"D_{i}_{j}", p=p, n=n, device=cards[kind], s0=s0) if kind >= 0 else None

    rows, columns = ([_line(train.t, x[:, k]) for k in range(x.shape[1])] for x in (train.v_row, train.v_column))
    elements = _written_out(array.crossbar(), rows, columns, memristor)
    return Netlist(name="crossbar", t_end=float(train.t[-1]), elements=elements)


def _line(t: FloatArray, volts: FloatArray) -> Waveform:
    return PiecewiseLinear(times=tuple(t.tolist()), values=tuple(volts.tolist()))


def _written_out(
    crossbar: Crossbar,
    rows: list[Any],
    columns: list[Any] | None,
    device: Callable[[int, int, str, str], Element | None],
) -> tuple[Element, ...]:
    """All elements: sources on the rows, at the senses where `columns` are given, wires, and what `device` makes."""
    m, n = crossbar.shape
    row = [[f"row_{i}_{j}" if crossbar.r_row else f"row_{i}" for j in range(n)] for i in range(m)]
    column = [[f"column_{i}_{j}" if crossbar.r_column else f"column_{j}" for j in range(n)] for i in range(m)]
    parts: list[Element] = []
    held = ["0"] * n
    if columns is not None:
        held = [f"sense_{j}" for j in range(n)]
        parts += [VoltageSource(name=f"H_{j}", p=held[j], n="0", voltage=columns[j]) for j in range(n)]
    for i in range(m):
        ends = {"P": row[i][0], "Q": row[i][-1]} if crossbar.drive == "both" else {"P": row[i][0]}
        if crossbar.r_row == 0.0:
            ends = {"P": row[i][0]}
        r = (crossbar.r_row + float(crossbar.r_driver[i])) / (2.0 if _is_doubled(crossbar.drive, crossbar.r_row) else 1)
        parts.append(VoltageSource(name=f"V_{i}", p=f"drive_{i}", n="0", voltage=rows[i]))
        parts += [Resistor(name=f"{k}_{i}", p=f"drive_{i}", n=node, resistance=r) for k, node in ends.items()
                  if np.isfinite(r)]  # fmt: skip
    for j in range(n):
        ends = {"S": column[-1][j], "T": column[0][j]} if crossbar.sense == "both" else {"S": column[-1][j]}
        if crossbar.r_column == 0.0:
            ends = {"S": column[0][j]}
        r = crossbar.r_column + float(crossbar.r_sense[j])
        r /= 2.0 if _is_doubled(crossbar.sense, crossbar.r_column) else 1.0
        parts += [
            Resistor(name=f"{k}_{j}", p=node, n=held[j], resistance=r) for k, node in ends.items() if np.isfinite(r)
        ]
    for i, j in np.ndindex(m, n):
        part = device(i, j, row[i][j], column[i][j])
        parts += [] if part is None else [part]
        if crossbar.r_row > 0.0 and j + 1 < n:
            parts.append(Resistor(name=f"W_{i}_{j}", p=row[i][j], n=row[i][j + 1], resistance=crossbar.r_row))
        if crossbar.r_column > 0.0 and i + 1 < m:
            parts.append(Resistor(name=f"U_{i}_{j}", p=column[i][j], n=column[i + 1][j], resistance=crossbar.r_column))
    return tuple(parts)


def _is_doubled(ends: str, segment: float) -> bool:
    """Whether two terminations in parallel act on one node: both ends of a line without resistance."""
    return ends == "both" and segment == 0.0
