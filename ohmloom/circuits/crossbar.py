"""A crossbar of resistive devices with wire resistance: currents, node voltages, the exact linear map between them."""

from __future__ import annotations

import html
from dataclasses import dataclass
from dataclasses import replace as replace_fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom.circuits._line_solver import solve
from ohmloom.circuits._lines import make_lines
from ohmloom.circuits._newton import solve_nonlinear
from ohmloom.circuits.conduction import Conduction
from ohmloom.circuits.crossbar_read import Read, Side
from ohmloom.errors import ParameterError, UnknownNameError, expect_number, expect_type, shown
from ohmloom.units import format_quantity

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Drive = Literal["left", "both"]
Sense = Literal["bottom", "both"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Crossbar:
    """Devices at the crosspoints of rows (word lines) and columns (bit lines).

    A row is driven before column 0 through one segment `r_row` plus `r_driver`; a column is sensed after the last
    row through one segment `r_column` plus `r_sense` into virtual ground; the far ends are open. Current is positive
    into the sense.

    Attributes
    ----------
    conductance
        S, axes (..., word_line, bit_line); 0 is an open device. Leading axes are a batch.
    r_row, r_column
        Resistance of one wire segment [ohm]; 0 is allowed on either side or both.
    r_driver, r_sense
        Resistance of each driver and of each sense [ohm]: one number, or axes (word_line,) and (bit_line,); infinite
        leaves the line floating.
    drive, sense
        "both": rows are driven, columns sensed, at their far ends too, through the same resistances.
    conduction
        How a device conducts beyond low field, `SinhConduction` or `SelectorConduction`; None: ohmic. The conductance
        is then that at low field (of the open selector).

    Raises
    ------
    ParameterError
        If a value is negative or NaN, or shapes disagree.

    Examples
    --------
    >>> import numpy as np
    >>> array = Crossbar(conductance=np.full((2, 3), 1e-3), r_row=10.0, r_column=10.0)
    >>> array.read([1.0, 0.5]).current.round(6).tolist()
    [0.00142, 0.001393, 0.00138]
    """

    conductance: FloatArray
    r_row: float = 0.0
    r_column: float = 0.0
    r_driver: Any = 0.0
    r_sense: Any = 0.0
    drive: Drive = "left"
    sense: Sense = "bottom"
    conduction: Conduction | None = None

    def __post_init__(self) -> None:
        """Check and freeze."""
        g = _numbers("Crossbar.conductance", self.conductance, "S")
        if g.ndim < 2 or 0 in g.shape:
            raise ParameterError(f"Crossbar.conductance: expected axes (..., word_line, bit_line), none of them empty, "
                                 f"got shape {g.shape}. Give one row per word line.")  # fmt: skip
        if not (np.isfinite(g) & (g >= 0.0)).all():
            bad = g[~(np.isfinite(g) & (g >= 0.0))].flat[0]
            raise ParameterError(f"Crossbar.conductance: expected finite conductances of 0 S or more, got {bad:g} S. "
                                 "0 is an open device.")  # fmt: skip
        object.__setattr__(self, "conductance", _locked(g))
        for name in ("r_row", "r_column"):
            value = expect_number(f"Crossbar.{name}", getattr(self, name), "a finite resistance per segment in ohm")
            if value < 0.0:
                raise ParameterError(f"Crossbar.{name}: expected 0 ohm or more, got {value:g} ohm. Correct it.")
            object.__setattr__(self, name, value)
        for name, axis, size in (("r_driver", "word_line", g.shape[-2]), ("r_sense", "bit_line", g.shape[-1])):
            r = _numbers(f"Crossbar.{name}", getattr(self, name), "ohm")
            if r.shape not in ((), (size,)):
                raise ParameterError(f"Crossbar.{name}: expected one resistance, or axes ({axis}={size},), got shape "
                                     f"{r.shape}. Give one per line.")  # fmt: skip
            if not (r >= 0.0).all():
                raise ParameterError(f"Crossbar.{name}: expected 0 ohm or more, infinite for a floating line, got "
                                     f"{r[~(r >= 0.0)].flat[0]:g} ohm. Correct it.")  # fmt: skip
            object.__setattr__(self, name, _locked(np.broadcast_to(r, (size,)).copy()))
        for field, chosen, known in (
            ("drive", self.drive, ("left", "both")),
            ("sense", self.sense, ("bottom", "both")),
        ):
            expect_type(f"Crossbar.{field}", chosen, str)
            if chosen not in known:
                raise UnknownNameError.of(f"Crossbar.{field}", chosen, known)
        if self.conduction is not None:
            expect_type(
                "Crossbar.conduction",
                self.conduction,
                Conduction,
                name="a SinhConduction, a SelectorConduction, or None",
            )

    @property
    def shape(self) -> tuple[int, int]:
        """Number of word lines and of bit lines."""
        return self.conductance.shape[-2], self.conductance.shape[-1]

    def replace(self, **changes: Any) -> Crossbar:
        """A copy with other values; names are those of the attributes."""
        unknown = [name for name in changes if name not in self.__dataclass_fields__]
        if unknown:
            raise UnknownNameError.of("Crossbar.replace", unknown[0], self.__dataclass_fields__)
        return replace_fields(self, **changes)

    def with_stuck(self, where: Any, conductance: float) -> Crossbar:
        """A copy in which the devices of a mask have one conductance, whatever they had.

        Parameters
        ----------
        where
            Booleans, axes (..., word_line, bit_line), which broadcast against the conductances.
        conductance
            S; 0 for stuck open.

        Examples
        --------
        >>> import numpy as np
        >>> array = Crossbar(conductance=np.full((2, 2), 1e-3))
        >>> array.with_stuck([[True, False], [False, False]], 0.0).read([1.0, 1.0]).current.tolist()
        [0.001, 0.002]
        """
        mask = np.asarray(where)
        try:
            if mask.dtype != np.bool_:
                raise ValueError
            shape = np.broadcast_shapes(mask.shape, self.conductance.shape)
        except ValueError:
            raise ParameterError(f"Crossbar.with_stuck: where: expected booleans that broadcast against axes (..., "
                                 f"word_line={self.shape[0]}, bit_line={self.shape[1]}), got {mask.dtype} of shape "
                                 f"{mask.shape}. Give one per device.") from None  # fmt: skip
        value = expect_number("Crossbar.with_stuck: conductance", conductance, "a conductance in S")
        return self.replace(conductance=np.where(mask, value, np.broadcast_to(self.conductance, shape)))

    def read(self, v: Any, *, guess: Read | None = None) -> Read:
        """Currents for voltages on the rows.

        Parameters
        ----------
        v
            Of the row drivers [V], axes (..., word_line); leading axes broadcast against those of the conductances.
        guess
            A read of a similar ohmic crossbar with the same shapes to start from.

        Raises
        ------
        ParameterError
            If shapes disagree or a voltage is not finite.
        OperationError
            If the solution does not converge; no numbers are returned.
        """
        voltages = _voltages("Crossbar.read: v", v, "word_line", self.shape[0])
        batch = _broadcast("Crossbar.read: v", voltages.shape[:-1], self.conductance.shape[:-2])
        return self._solve(voltages, batch, guess)

    def read_transposed(self, v: Any) -> Read:
        """The same array driven at the senses and sensed at the drivers: `v` axes (..., bit_line).

        The result's `current` has axes (..., word_line), positive into what were the drivers; its potentials keep
        the axes (..., word_line, bit_line), and its device currents count from row to column. By reciprocity its
        operator is the transpose of `operator`.
        """
        turned = Crossbar(
            conductance=np.swapaxes(self.conductance, -1, -2)[..., ::-1, ::-1], r_row=self.r_column,
            r_column=self.r_row, r_driver=self.r_sense[::-1], r_sense=self.r_driver[::-1],
            drive="both" if self.sense == "both" else "left", sense="both" if self.drive == "both" else "bottom",
            conduction=self.conduction,
        )  # fmt: skip
        voltages = _voltages("Crossbar.read_transposed: v", v, "bit_line", self.shape[1])
        read = turned.read(voltages[..., ::-1])

        def back(x: FloatArray) -> FloatArray:
            return np.swapaxes(x[..., ::-1, ::-1], -1, -2)

        rows, columns = read._sides
        flipped = tuple(Side(segment=side.segment, ends=side.ends[::-1, ::-1], held=side.held[..., ::-1, ::-1])
                        for side in (columns, rows))  # fmt: skip
        return replace_fields(read, current=read.current[..., ::-1], v_row=back(read.v_column),
                              v_column=back(read.v_row), device_current=-back(read.device_current),
                              _sides=(flipped[0], flipped[1]))  # fmt: skip

    def operator(self) -> FloatArray:
        """The exact linear map from row voltages to column currents [S], axes (..., word_line, bit_line).

        ``read(v).current`` is ``v @ operator()``. By recursive substructuring where both wires resist and far ends
        are open, else by one read per row.

        Raises
        ------
        ParameterError
            If devices are not ohmic, since there is no linear map then.
        """
        if self.conduction is not None:
            raise ParameterError("Crossbar.operator: expected ohmic devices, got "
                                 f"{type(self.conduction).__name__}. Read, or replace(conduction=None).")  # fmt: skip
        m, n = self.shape
        g = self.conductance.reshape(-1, m, n)
        # The blocks are padded at the far ends, which therefore must be open.
        is_open = (self.drive, self.sense) == ("left", "bottom")
        if self.r_row > 0.0 and self.r_column > 0.0 and is_open:
            from ohmloom.circuits._substructure import operator

            found = operator(g, 1.0 / self.r_row, 1.0 / self.r_column, self.r_driver, self.r_sense)
            return found.reshape(self.conductance.shape)
        reads = self.replace(conductance=g[:, None]).read(np.eye(m))
        return reads.current.reshape(self.conductance.shape)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the conductances as a heat map; see `ohmloom.circuits.plot_crossbar` for currents, IR drop and more."""
        from ohmloom.circuits.plots import plot_crossbar

        return plot_crossbar(self, ax=ax)

    def write_csv(self, path: str | Path) -> None:
        """Write ``word_line,bit_line,conductance_S``, a line per device, whole or not at all.

        Raises
        ------
        ParameterError
            If this is a batch.
        """
        from ohmloom.circuits.tables import write_placement

        write_placement(self, path)

    def _solve(self, v: FloatArray, batch: tuple[int, ...], guess: Read | None) -> Read:
        m, n = self.shape
        own = self.conductance.shape[:-2]
        # A single crossbar takes all patterns at once; else each member of the batch has its own pattern, as it has
        # where the tangents of its devices depend on the pattern.
        if int(np.prod(own)) == 1 and self.conduction is None:
            g, volts = self.conductance.reshape(1, m, n), np.broadcast_to(v, (*batch, m)).reshape(-1, 1, m)
        else:
            g = np.broadcast_to(self.conductance, (*batch, m, n)).reshape(-1, m, n)
            volts = np.broadcast_to(v, (*batch, m)).reshape(1, -1, m)
        sides = self._sides(volts)
        if self.conduction is not None:
            if guess is not None:
                raise ParameterError("Crossbar.read: guess: expected none for devices that are not ohmic, got a read. "
                                     "Leave it out.")  # fmt: skip
            held = [(side.segment, side.ends, side.held) for side in sides]
            u, w, device, iterations = solve_nonlinear(g, held[0], held[1], self.conduction)
            return self._as_read(v, batch, u, w, device, iterations)
        rows = make_lines(g, self.r_row, sides[0].ends, sides[0].held)
        turned = np.ascontiguousarray(np.swapaxes(g, -1, -2))
        columns = make_lines(turned, self.r_column, sides[1].ends, sides[1].held)
        start = None
        if guess is not None:
            expect_type("Crossbar.read: guess", guess, Read)
            if guess.v_row.shape != (*batch, m, n):
                raise ParameterError(f"Crossbar.read: guess: expected a read of shape {(*batch, m, n)}, got "
                                     f"{guess.v_row.shape}. Leave it out.")  # fmt: skip
            start = guess.v_row.reshape(*volts.shape[:2], m, n)
        u, w, iterations = solve(g, rows, columns, start)
        return self._as_read(v, batch, u, w, g * (u - w), iterations)

    def _as_read(self, v: FloatArray, batch: tuple[int, ...], u: FloatArray, w: FloatArray, device: FloatArray,
                 iterations: int) -> Read:  # fmt: skip
        m, n = self.shape
        current = device.sum(axis=-2)
        # Nothing leaves a column that floats at both ends, but for rounding.
        current[..., np.isinf(self.r_sense)] = 0.0
        shape = (*batch, m, n)
        sides = self._sides(np.broadcast_to(v, (*batch, m)))
        return Read(
            current=_locked(current.reshape(*batch, n)), v_row=_locked(u.reshape(shape)),
            v_column=_locked(w.reshape(shape)), device_current=_locked(device.reshape(shape)),
            iterations=iterations, _sides=sides,
        )  # fmt: skip

    def _sides(self, volts: FloatArray) -> tuple[Side, Side]:
        """Rows, driven by `volts`, axes (..., word_line), and columns, held at ground."""
        rows = _ends(self.r_row + self.r_driver, near_is_first=True, both=self.drive == "both")
        columns = _ends(self.r_column + self.r_sense, near_is_first=False, both=self.sense == "both")
        ground = np.zeros((*volts.shape[:-1], self.shape[1], 2))
        return (Side(segment=self.r_row, ends=rows, held=np.repeat(volts[..., None], 2, axis=-1)),
                Side(segment=self.r_column, ends=columns, held=ground))  # fmt: skip

    def _repr_html_(self) -> str:
        g = self.conductance
        rows = [
            ("word lines x bit lines", f"{g.shape[-2]} x {g.shape[-1]}"),
            ("batch", " x ".join(map(str, g.shape[:-2])) or "none"),
            ("conductance", f"{format_quantity(float(g.min()), 'S')} to {format_quantity(float(g.max()), 'S')}"),
            ("wire segment", f"{self.r_row:g} ohm per row, {self.r_column:g} ohm per column"),
        ]
        cells = "".join(f"<tr><th>{html.escape(a)}</th><td>{html.escape(b)}</td></tr>" for a, b in rows)
        return f"<table>{cells}</table>"


def _ends(resistance: FloatArray, *, near_is_first: bool, both: bool) -> FloatArray:
    """Conductance of both terminations of each line, axes (line, end=2)."""
    with np.errstate(divide="ignore"):
        near = 1.0 / resistance
    far = near if both else np.zeros_like(near)
    return np.stack([near, far] if near_is_first else [far, near], axis=-1)


def _numbers(where: str, values: Any, unit: str) -> FloatArray:
    try:
        return np.array(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise ParameterError(f"{where}: expected numbers in {unit}, got {shown(values)}. Give an array.") from error


def _voltages(where: str, v: Any, axis: str, size: int) -> FloatArray:
    volts = _numbers(where, v, "V")
    if volts.ndim < 1 or volts.shape[-1] != size:
        raise ParameterError(f"{where}: expected axes (..., {axis}={size}), got shape {volts.shape}. "
                             f"Give one voltage per {axis.replace('_', ' ')}.")  # fmt: skip
    if not np.isfinite(volts).all():
        raise ParameterError(f"{where}: expected finite voltages, got NaN or infinity. Use r_driver=inf for a floating "
                             "line.")  # fmt: skip
    return volts


def _broadcast(where: str, patterns: tuple[int, ...], batch: tuple[int, ...]) -> tuple[int, ...]:
    try:
        return np.broadcast_shapes(patterns, batch)
    except ValueError as error:
        raise ParameterError(f"{where}: expected leading axes that broadcast against those of the conductances, "
                             f"{batch}, got {patterns}. Put the batch axes of v where those of the conductances "
                             "are.") from error  # fmt: skip


def _locked(array: FloatArray) -> FloatArray:
    array.flags.writeable = False
    return array
