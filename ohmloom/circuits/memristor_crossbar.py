"""A crossbar of memristors through time: driven lines, wire resistance, states, currents and energy."""

from __future__ import annotations

import html
import json
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ohmloom._arrays import FloatArray, IntArray, frozen_array, read_arrays, write_arrays
from ohmloom.circuits.crossbar import Crossbar, Drive, Sense
from ohmloom.devices import LAWS, Device
from ohmloom.errors import FileFormatError, OperationError, ParameterError, expect_number, expect_type
from ohmloom.units import format_quantity

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TOLERANCE = 1e-10
ARRAYS = ("t", "v_row", "v_column", "s", "current", "energy")
# States and voltages at which a law's conductance is compared with that at none, to see whether it depends on voltage.
PROBE_STATES, PROBE_VOLTAGES = (0.1, 0.5, 0.9), (-1.0, -0.1, 0.1, 1.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class CrossbarTrace:
    """What happened to a crossbar, SI.

    Attributes
    ----------
    t, v_row, v_column
        Times, axes (time,), and the voltages of drivers and senses, axes (time, word_line) and (time, bit_line).
    s
        State of each device, axes (time, word_line, bit_line).
    current
        From all devices into each column, axes (time, bit_line).
    energy
        Taken up by each device since the start [J], axes (time, word_line, bit_line).
    supplied
        Energy that drivers and senses gave in all [J]; what the devices did not take, wires, drivers and senses did.
    steps
        Integration steps.
    provenance
        JSON text: version and settings.
    """

    t: FloatArray
    v_row: FloatArray
    v_column: FloatArray
    s: FloatArray
    current: FloatArray
    energy: FloatArray
    supplied: float
    steps: int
    provenance: str = "{}"

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        axes = {"t": ("time",), "v_row": ("time", "word_line"), "v_column": ("time", "bit_line"),
                "s": ("time", "word_line", "bit_line"), "current": ("time", "bit_line"),
                "energy": ("time", "word_line", "bit_line")}  # fmt: skip
        for name in ARRAYS:
            object.__setattr__(self, name, frozen_array(f"CrossbarTrace.{name}", getattr(self, name), axes[name]))

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the current of every column over time; returns the axes."""
        if ax is None:
            from matplotlib.figure import Figure

            ax = Figure(layout="constrained").subplots()
        ax.plot(self.t, self.current)
        ax.set_xlabel("time [s]")
        ax.set_ylabel("current into the senses [A]")
        return ax

    def save(self, path: str | Path) -> None:
        """Write everything as npz: the same trace always gives the same bytes."""
        header = {"supplied": self.supplied, "steps": self.steps, "provenance": json.loads(self.provenance)}
        write_arrays(path, "crossbar_trace", 1, header, {name: getattr(self, name) for name in ARRAYS})

    @classmethod
    def load(cls, path: str | Path) -> CrossbarTrace:
        """Read what `save` wrote.

        Raises
        ------
        MissingFileError
            If the file does not exist.
        FileFormatError
            If it is not a whole trace file.
        """
        header, arrays = read_arrays(path, "crossbar_trace", 1, ARRAYS)
        try:
            return cls(**arrays, supplied=float(header["supplied"]), steps=int(header["steps"]),
                       provenance=json.dumps(header.get("provenance", {}), sort_keys=True))  # fmt: skip
        except (ParameterError, KeyError, TypeError, ValueError) as error:
            raise FileFormatError(f"{path}: expected a whole trace, got {error}. Simulate again.") from error

    def _repr_html_(self) -> str:
        rows = [
            ("crossbar", f"{self.s.shape[1]} x {self.s.shape[2]}"),
            ("times", str(self.t.size)),
            ("duration", format_quantity(float(self.t[-1] - self.t[0]), "s")),
            ("largest change of s", f"{float(np.abs(self.s[-1] - self.s[0]).max()):.3g}"),
            ("energy supplied", format_quantity(self.supplied, "J")),
        ]
        cells = "".join(f"<tr><th>{html.escape(a)}</th><td>{html.escape(b)}</td></tr>" for a, b in rows)
        return f"<table>{cells}</table>"


@dataclass(frozen=True, kw_only=True, eq=False)
class MemristorCrossbar:
    """Memristors at the crosspoints of a `Crossbar`, whose conventions hold.

    Attributes
    ----------
    devices
        One device, or several kinds.
    s
        State of each device, axes (word_line, bit_line), in [0, 1].
    kind
        Which of `devices` stands at each crosspoint, axes (word_line, bit_line); -1 for an open one. None: the first.
    r_row, r_column, r_driver, r_sense, drive, sense
        As in `Crossbar`; a line without wire resistance may still have one at its ends.

    Raises
    ------
    ParameterError
        If a value is out of range, or shapes disagree.

    Examples
    --------
    >>> array = MemristorCrossbar(devices=Device.load("hp_tio2_10k"), s=[[0.5, 0.5]], r_row=1.0, r_column=1.0)
    >>> trace = array.simulate([0.0, 1e-3], [[1.0], [1.0]])
    >>> bool((trace.s[-1] > 0.5).all()), trace.current.shape
    (True, (2, 2))
    """

    devices: Device | tuple[Device, ...]
    s: FloatArray
    kind: IntArray | None = None
    r_row: float = 0.0
    r_column: float = 0.0
    r_driver: Any = 0.0
    r_sense: Any = 0.0
    drive: Drive = "left"
    sense: Sense = "bottom"

    def __post_init__(self) -> None:
        """Check and freeze; the crossbar of the initial conductances checks wires and ends."""
        devices = (self.devices,) if isinstance(self.devices, Device) else tuple(self.devices)
        for device in devices:
            expect_type("MemristorCrossbar.devices", device, Device)
        if not devices:
            raise ParameterError("MemristorCrossbar.devices: expected at least one Device, got none. Load a card.")
        object.__setattr__(self, "devices", devices)
        s = frozen_array("MemristorCrossbar.s", self.s, ("word_line", "bit_line"))
        if not ((s >= 0.0) & (s <= 1.0)).all():
            bad = s[(s < 0.0) | (s > 1.0)].flat[0]
            raise ParameterError(f"MemristorCrossbar.s: expected states in [0, 1], got {bad:g}. Divide charges by the "
                                 "device's charge_scale.")  # fmt: skip
        object.__setattr__(self, "s", s)
        kind = np.zeros(s.shape, dtype=np.int64) if self.kind is None else frozen_array(
            "MemristorCrossbar.kind", self.kind, ("word_line", "bit_line"), dtype=np.int64)  # fmt: skip
        if kind.shape != s.shape or kind.min(initial=0) < -1 or kind.max(initial=0) >= len(devices):
            raise ParameterError(f"MemristorCrossbar.kind: expected axes (word_line={s.shape[0]}, "
                                 f"bit_line={s.shape[1]}) with numbers from -1 to {len(devices) - 1}, got shape "
                                 f"{kind.shape} from {kind.min(initial=0)} to {kind.max(initial=0)}. "
                                 "Number the devices from 0.")  # fmt: skip
        object.__setattr__(self, "kind", kind)
        wires = self.crossbar()
        object.__setattr__(self, "r_driver", wires.r_driver)
        object.__setattr__(self, "r_sense", wires.r_sense)

    def crossbar(self) -> Crossbar:
        """The resistive crossbar of the present states at vanishing voltage."""
        g = np.zeros(self.s.shape)
        for k, device in enumerate(self._cards):
            here = self._kinds == k
            g[here] = device.conductance(self.s[here])
        return Crossbar(conductance=g, r_row=self.r_row, r_column=self.r_column, r_driver=self.r_driver,
                        r_sense=self.r_sense, drive=self.drive, sense=self.sense)  # fmt: skip

    def write_csv(self, path: str | Path) -> None:
        """Write ``word_line,bit_line,card,s,conductance_S``, a line per crosspoint, whole or not at all."""
        from ohmloom.circuits.tables import write_devices

        write_devices(self, path)

    def simulate(self, t: Any, v_row: Any, v_column: Any = 0.0, *, tolerance: float = TOLERANCE) -> CrossbarTrace:
        """Drive the lines and follow every device.

        An ideal law is integrated in its flux, which hardly bends within a pulse: ``d phi/dt`` is the device's voltage.
        Any other is integrated in its state, by explicit steps: a state that relaxes far faster than its drive changes
        costs as many more, and one that snaps faster than times can tell, as of `pickett` at 1 V, is an error. Walls
        are `clip`.

        Parameters
        ----------
        t
            Times in s, axes (time,), strictly increasing; put one at every corner of the waveforms.
        v_row
            Of the drivers [V], axes (time, word_line), linear between times.
        v_column
            What the senses hold [V], axes (time, bit_line), or one number.
        tolerance
            Error of each step, as a share of the range of the state.

        Raises
        ------
        ParameterError
            If an input breaks these rules.
        OperationError
            If a step does not converge, or a state snaps faster than times can tell; names the time.
        """
        from ohmloom.circuits._transient_kernels import follow

        times = frozen_array("MemristorCrossbar.simulate: t", t, ("time",))
        if times.size < 2 or not (np.diff(times) > 0.0).all():
            raise ParameterError("MemristorCrossbar.simulate: t: expected at least two times in s, strictly "
                                 f"increasing, got {times.size}. A pulse of no length has no place; drop "
                                 "repeats.")  # fmt: skip
        m, n = self.s.shape
        rows = _drive("v_row", v_row, (times.size, m), "word_line")
        columns = _drive("v_column", v_column, (times.size, n), "bit_line")
        limit = expect_number("MemristorCrossbar.simulate: tolerance", tolerance)
        if not 0.0 < limit < 1.0:
            raise ParameterError(f"MemristorCrossbar.simulate: tolerance: expected more than 0 and less than 1, "
                                 f"got {limit:g}. 1e-10 is good.")  # fmt: skip
        array, y = self._compiled()
        fine, grown_rows, grown_columns, kept = _with_sign_changes(times, rows, columns)
        states, energies = np.empty((fine.size, m, n)), np.zeros((fine.size, m, n))
        currents = np.empty((fine.size, n))
        failed, supplied, steps = follow(
            array, y, self.s.copy(), fine, grown_rows, grown_columns, limit, states, currents, energies
        )
        if failed:
            raise OperationError(f"MemristorCrossbar.simulate: expected every step to converge, got none after t = "
                                 f"{fine[max(failed - 2, 0)]:.6g} s. Give t finer steps there, or lower "
                                 "the voltage.")  # fmt: skip
        made = {"ohmloom": version("ohmloom"), "devices": [device.sha256 for device in self._cards],
                "r_row": self.r_row, "r_column": self.r_column, "tolerance": limit}  # fmt: skip
        return CrossbarTrace(
            t=times, v_row=rows, v_column=columns, s=states[kept], current=currents[kept], energy=energies[kept],
            supplied=float(supplied), steps=int(steps), provenance=json.dumps(made, sort_keys=True),
        )  # fmt: skip

    @property
    def _cards(self) -> tuple[Device, ...]:
        assert isinstance(self.devices, tuple)
        return self.devices

    @property
    def _kinds(self) -> IntArray:
        assert self.kind is not None
        return self.kind

    def _compiled(self) -> tuple[Any, FloatArray]:
        """What the kernels take, and where each device starts: its flux if its law is ideal, else its state."""
        from ohmloom.devices._kernels import LAW_INDEX

        cards = self._cards
        width = max(len(device.parameters) for device in cards)
        parameters = np.zeros((len(cards), width))
        for k, device in enumerate(cards):
            parameters[k, : len(device.parameters)] = list(device.parameters.values())
        ideal = np.array([LAWS[device.law].is_ideal for device in cards])
        y_max = np.array([device.flux(1.0) if is_ideal else 1.0 for device, is_ideal in zip(cards, ideal, strict=True)])
        bends = np.array([any(device.conductance(s, v) != device.conductance(s) for s in PROBE_STATES
                              for v in PROBE_VOLTAGES) for device in cards])  # fmt: skip
        which = np.maximum(self._kinds, 0)
        y = self.s.copy()
        for k, device in enumerate(cards):
            if ideal[k]:
                y[which == k] = device.flux(self.s[which == k])
        near_row, near_column = self.r_row + self.r_driver, self.r_column + self.r_sense
        with np.errstate(divide="ignore"):
            drivers, senses = 1.0 / near_row, 1.0 / near_column
        far_row = drivers if self.drive == "both" else np.zeros_like(drivers)
        far_column = senses if self.sense == "both" else np.zeros_like(senses)
        return (
            np.array([LAW_INDEX[device.law] for device in cards], dtype=np.int64), which, parameters,
            np.array([device.charge_scale for device in cards]), y_max, ideal, bends, self._kinds >= 0,
            (self.r_row, drivers, far_row), (self.r_column, far_column, senses),
        ), y  # fmt: skip


def _drive(name: str, values: Any, shape: tuple[int, int], axis: str) -> FloatArray:
    """A voltage for every time and line, axes (time, line); a single number stands for all."""
    if np.ndim(values) == 0:
        values = np.full(shape, expect_number(f"MemristorCrossbar.simulate: {name}", values, "a voltage in V"))
    drive: FloatArray = frozen_array(f"MemristorCrossbar.simulate: {name}", values, ("time", axis))
    if drive.shape != shape:
        raise ParameterError(f"MemristorCrossbar.simulate: {name}: expected axes (time={shape[0]}, "
                             f"{axis}={shape[1]}), got shape {drive.shape}. Give one per time and line.")  # fmt: skip
    return drive


def _with_sign_changes(
    t: FloatArray, rows: FloatArray, columns: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
    """The same drive with a time at each change of sign between a row and a column; and where the old times are.

    A device that leaves its wall does so where its voltage turns, so that no step may span it.
    """
    difference = rows[:, :, None] - columns[:, None, :]
    turning = difference[:-1] * difference[1:] < 0.0
    before, after = difference[:-1][turning], difference[1:][turning]
    segment = np.nonzero(turning)[0]
    added = t[segment] + before / (before - after) * np.diff(t)[segment]
    fine = np.unique(np.concatenate([t, added]))
    at = np.clip(np.searchsorted(t, fine, side="right") - 1, 0, t.size - 2)
    share = ((fine - t[at]) / (t[at + 1] - t[at]))[:, None]
    grown = [x[at] + share * (x[at + 1] - x[at]) for x in (rows, columns)]
    return fine, grown[0], grown[1], np.searchsorted(fine, t)
