"""Modified nodal analysis: a circuit analysed once into matrices, solved at many times and states.

Unknowns `x` are the node voltages and the currents of elements that fix a voltage. Linear elements stand in `matrix`;
a memristor is an incidence column of `ports` with the current ``G(s, v) v``. A capacitor is a source of its state
voltage. Where it closes a loop of capacitors and sources its voltage is no state: its current follows from those of
the others, ``i = C d/dt (sum of the loop's voltages)``, which is linear too.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom.circuits._topology import capacitor_tree, is_ideal
from ohmloom.circuits.elements import VCCS, VCVS, Capacitor, CurrentSource, Memristor, Resistor, Simple, VoltageSource
from ohmloom.circuits.waveforms import Waveform
from ohmloom.devices import LAWS
from ohmloom.errors import OperationError, ParameterError

MOST_ROUNDS, MOST_HALVINGS = 100, 40
# Newton's iteration ends where the memristors' voltages stand still to this, relatively and in V.
SETTLED, SETTLED_VOLTS = 1e-12, 1e-15
# Share of the voltage over which a memristor's differential conductance is taken.
DIFFERENCE = 1e-6
# Of the matrix with its rows and columns scaled: beyond, no digit of the solution is left.
SINGULAR = 1e-15


class System:
    """The matrices of one circuit for one analysis.

    `sources` are the waveforms in the order of the columns of `by_source` and `by_slope`; `capacitors` those whose
    voltages are states, in the order of the columns of `by_capacitor`.
    """

    def __init__(self, elements: Sequence[Simple], nodes: Sequence[str], *, is_dc: bool) -> None:
        self.elements, self.nodes = elements, nodes
        self.capacitors, self.links = ([], {}) if is_dc else capacitor_tree(elements)
        self.memristors = [element for element in elements if isinstance(element, Memristor)]
        self.devices = _Devices(self.memristors)
        self._source_elements = [e for e in elements if isinstance(e, VoltageSource | CurrentSource)]
        self.sources: list[Waveform] = [_waveform(e) for e in self._source_elements]
        branches = [e for e in elements if is_ideal(e) or (isinstance(e, Capacitor) and not is_dc)]
        # Ground is row 0 while stamping and is then left out.
        self._index = {node: k for k, node in enumerate(("0", *nodes))}
        self.branch = {e.name: len(self._index) + k for k, e in enumerate(branches)}
        self.size = len(self._index) + len(branches)
        self._matrix = np.zeros((self.size, self.size))
        self._reading = np.zeros((len(elements), self.size))
        self._source_reading = np.zeros((len(elements), len(self.sources)))
        self.by_source, self.by_slope = np.zeros((2, self.size, len(self.sources)))
        self.by_capacitor = np.zeros((self.size, len(self.capacitors)))
        self.ports = np.zeros((self.size, len(self.memristors)))
        self.incidence = np.zeros((self.size, len(elements)))
        for row, element in enumerate(elements):
            p, n = self._index[element.p], self._index[element.n]
            self.incidence[p, row], self.incidence[n, row] = 1.0, -1.0
            self._stamp(row, element, p, n)
        for name in ("_matrix",):
            setattr(self, name, getattr(self, name)[1:, 1:])
        for name in ("by_source", "by_slope", "by_capacitor", "ports", "incidence"):
            setattr(self, name, getattr(self, name)[1:])
        self._reading = self._reading[:, 1:]
        self.branch = {name: k - 1 for name, k in self.branch.items()}
        self.memristor_rows = [k for k, e in enumerate(elements) if isinstance(e, Memristor)]
        self.capacitances = np.array([c.capacitance for c in self.capacitors])
        self.capacitor_rows = [self.branch[c.name] for c in self.capacitors]

    def right_side(self, t: float, capacitor_voltages: FloatArray, slope_at: float | None = None) -> FloatArray:
        """What drives the circuit at the time `t`; slopes of the sources are taken at `slope_at`."""
        values = np.array([source.value(t) for source in self.sources])
        side = self.by_source @ values + self.by_capacitor @ capacitor_voltages
        if self.links:
            side = side + self.by_slope @ np.array([s.slope(t if slope_at is None else slope_at) for s in self.sources])
        return np.asarray(side)

    def solve(self, side: FloatArray, s: FloatArray, guess: FloatArray | None = None) -> FloatArray:
        """Node voltages and branch currents for the memristors' states `s`, from `guess` if one is at hand.

        Raises
        ------
        OperationError
            If Newton's iteration does not settle.
        """
        if not self.memristors:
            return np.asarray(np.linalg.solve(self._matrix, side), dtype=np.float64)
        if self.devices.are_ohmic:
            g = self.devices.conductance(s, np.zeros(s.size))
            matrix = self._matrix + (self.ports * g) @ self.ports.T
            return np.asarray(np.linalg.solve(matrix, side), dtype=np.float64)
        x = np.zeros(side.size) if guess is None else guess
        error = self._error(x, side, s)
        for _ in range(MOST_ROUNDS):
            slope = self.devices.slope(s, self.ports.T @ x)
            step = np.linalg.solve(self._matrix + (self.ports * slope) @ self.ports.T, -error)
            share = 1.0
            moved = self._error(x + step, side, s)
            # A sinh overshoots by powers of e; rounding alone may not let the error fall any more.
            for _ in range(MOST_HALVINGS):
                if np.isfinite(moved).all() and _norm(moved) <= _norm(error) * (1.0 + 1e-9) + 1e-300:
                    break
                if share * _norm(self.ports.T @ step) <= self._settled(x):
                    break
                share *= 0.5
                moved = self._error(x + share * step, side, s)
            x, error = x + share * step, moved
            if _norm(self.ports.T @ step) <= self._settled(x):
                return x
        raise OperationError(f"Netlist: expected Newton's iteration to settle, got a current of {_norm(error):.3g} A "
                             f"unbalanced after {MOST_ROUNDS} rounds. Check voltages and states.")  # fmt: skip

    def currents(self, x: FloatArray, t: float, s: FloatArray) -> FloatArray:
        """Current of each element from p to n, axes (element,)."""
        values = np.array([source.value(t) for source in self.sources])
        i = self._reading @ x + self._source_reading @ values
        v = self.ports.T @ x
        i[self.memristor_rows] = self.devices.conductance(s, v) * v
        return np.asarray(i)

    def unbalanced(self, currents: FloatArray) -> float:
        """Largest sum of currents out of a node, in A."""
        return _norm((self.incidence @ currents)[: len(self.nodes)])

    def check_solvable(self, s: FloatArray) -> None:
        """Refuse a circuit whose equations have no single solution; name what they leave open.

        Raises
        ------
        ParameterError
            Names nodes and elements whose voltage or current could be anything.
        """
        g = self.devices.conductance(s, np.zeros(s.size))
        matrix = self._matrix + (self.ports * g) @ self.ports.T
        # Conductances of 1e-12 S beside entries of 1 are no defect: scale rows and columns first, twice.
        columns = np.ones(matrix.shape[1])
        for _ in range(2):
            matrix = matrix / np.maximum(np.abs(matrix).max(axis=1), 1e-300)[:, None]
            sizes = np.maximum(np.abs(matrix).max(axis=0), 1e-300)
            matrix, columns = matrix / sizes, columns * sizes
        _, values, rows = np.linalg.svd(matrix)
        if values[-1] > SINGULAR * values[0]:
            return
        free = np.abs(rows[-1]) > 1e-3 * np.abs(rows[-1]).max()
        names = [f"node {node}" for node, is_free in zip(self.nodes, free, strict=False) if is_free]
        names += [f"current of {name}" for name, k in self.branch.items() if free[k]]
        raise ParameterError(f"Netlist.elements: expected equations with one solution, got none or many for "
                             f"{', '.join(names)}. Check controlled sources.")  # fmt: skip

    def _error(self, x: FloatArray, side: FloatArray, s: FloatArray) -> FloatArray:
        v = self.ports.T @ x
        return np.asarray(self._matrix @ x + self.ports @ (self.devices.conductance(s, v) * v) - side)

    def _settled(self, x: FloatArray) -> float:
        return SETTLED * _norm(self.ports.T @ x) + SETTLED_VOLTS

    def _stamp(self, row: int, element: Simple, p: int, n: int) -> None:
        if isinstance(element, Memristor):
            column = self.memristors.index(element)
            self.ports[p, column], self.ports[n, column] = 1.0, -1.0
        elif isinstance(element, CurrentSource):
            column = self._source_elements.index(element)
            self.by_source[p, column], self.by_source[n, column] = -1.0, 1.0
            self._source_reading[row, column] = 1.0
        elif isinstance(element, VCCS):
            cp, cn, gm = self._index[element.control_p], self._index[element.control_n], element.transconductance
            self._add(row, p, n, ((cp, gm), (cn, -gm)))
        elif isinstance(element, Resistor) and element.resistance > 0.0:
            g = 1.0 / element.resistance
            self._add(row, p, n, ((p, g), (n, -g)))
        elif element.name in self.branch:
            self._stamp_branch(row, element, p, n)

    def _add(self, row: int, p: int, n: int, terms: tuple[tuple[int, float], ...]) -> None:
        """A current from p to n that is a sum of factors times voltages."""
        for node, factor in terms:
            self._matrix[p, node] += factor
            self._matrix[n, node] -= factor
            self._reading[row, node] += factor

    def _stamp_branch(self, row: int, element: Simple, p: int, n: int) -> None:
        k = self.branch[element.name]
        self._reading[row, k] = 1.0
        self._matrix[p, k] += 1.0
        self._matrix[n, k] -= 1.0
        if element.name in self.links:
            self._stamp_link(k, element)
            return
        self._matrix[k, p] += 1.0
        self._matrix[k, n] -= 1.0
        if isinstance(element, VoltageSource):
            self.by_source[k, self._source_elements.index(element)] = 1.0
        elif isinstance(element, VCVS):
            self._matrix[k, self._index[element.control_p]] -= element.gain
            self._matrix[k, self._index[element.control_n]] += element.gain
        elif isinstance(element, Capacitor):
            self.by_capacitor[k, self.capacitors.index(element)] = 1.0

    def _stamp_link(self, k: int, element: Any) -> None:
        self._matrix[k, k] += 1.0
        for other, sign in self.links[element.name]:
            if isinstance(other, Capacitor):
                self._matrix[k, self.branch[other.name]] -= sign * element.capacitance / other.capacitance
            elif isinstance(other, VoltageSource):
                self.by_slope[k, self._source_elements.index(other)] += sign * element.capacitance


class _Devices:
    """Memristors, those of one card evaluated together."""

    def __init__(self, memristors: Sequence[Memristor]) -> None:
        cards = list(dict.fromkeys(m.device for m in memristors))
        self._groups = [
            (LAWS[card.law], tuple(card.parameters.values()), np.flatnonzero([m.device == card for m in memristors]))
            for card in cards
        ]
        self.charge_scale = np.array([m.device.charge_scale for m in memristors])
        self.are_ohmic = all(_is_ohmic(law, p) for law, p, _ in self._groups)

    def conductance(self, s: FloatArray, v: FloatArray) -> FloatArray:
        g = np.empty(s.size)
        for law, p, at in self._groups:
            g[at] = law.conductance(s[at], v[at], p)
        return g

    def slope(self, s: FloatArray, v: FloatArray) -> FloatArray:
        """d i/d v, by differences: it sets the speed of Newton's iteration, not where it ends."""
        step = DIFFERENCE * (np.abs(v) + 1e-3)
        above, below = v + step, v - step
        slopes = (self.conductance(s, above) * above - self.conductance(s, below) * below) / (2.0 * step)
        return np.asarray(slopes)

    def rate(self, s: FloatArray, v: FloatArray) -> FloatArray:
        """ds/dt before walls."""
        rates = np.empty(s.size)
        g = self.conductance(s, v)
        for law, p, at in self._groups:
            rates[at] = law.charge_rate(s[at], v[at], g[at] * v[at], p)
        return np.asarray(rates / self.charge_scale)


def _is_ohmic(law: Any, p: tuple[float, ...]) -> bool:
    return all(
        float(law.conductance(s, v, p)) == float(law.conductance(s, 0.0, p))
        for s in (0.0, 0.37, 1.0)
        for v in (-0.9, -1e-3, 0.2, 0.6)
    )


def _waveform(element: VoltageSource | CurrentSource) -> Waveform:
    waveform = element.voltage if isinstance(element, VoltageSource) else element.current
    assert isinstance(waveform, Waveform)
    return waveform


def _norm(x: FloatArray) -> float:
    return float(np.abs(x).max(initial=0.0))
