"""One memristor: a law with its parameters, and what can be asked of it."""

from __future__ import annotations

import html
import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom._files import sha256, write_atomic
from ohmloom.devices._checks import (
    LARGEST_VOLTAGE,
    check_number,
    check_size,
    drive_over,
    finite,
    like_input,
    rising_times,
)
from ohmloom.devices.card import Card, CardValue, DataFile, read_card, shipped_names, write_card
from ohmloom.devices.laws import LAWS
from ohmloom.devices.laws._law import problems
from ohmloom.devices.trace import Trace
from ohmloom.devices.walls import WALLS, Walls
from ohmloom.errors import ParameterError, UnknownNameError, expect_type
from ohmloom.units import format_quantity

if TYPE_CHECKING:
    from ohmloom.devices.simulate import Method

# A weight this close, relatively, to the end of its range is that end: R_on/R_off is rounded.
WEIGHT_SLACK = 1e-12


@dataclass(frozen=True, kw_only=True)
class Device:
    """A memristor model: ``i = G(s, v) v`` with the state ``s = q/q_d`` in [0, 1].

    Current counts positive into the first terminal, where positive voltage is applied, and then never lowers
    `s`.

    Attributes
    ----------
    name, law, source
        The card's name, the law's name (a key of `LAWS`), and where the card comes from.
    values
        One `CardValue` per parameter, in the order in which the law declares them, SI.
    data
        Measured files that the values were fitted to, with their digests.

    Raises
    ------
    ParameterError
        If the law is unknown, or a value breaks one of its rules.

    Examples
    --------
    >>> device = Device.load("hp_tio2")
    >>> device.law, device.parameters["r_on"]
    ('hp_linear', 100.0)
    >>> device.memristance(0.0), device.weight(1.0)
    (16000.0, 1.0)
    """

    name: str
    law: str
    source: str
    values: tuple[CardValue, ...]
    data: tuple[DataFile, ...] = ()

    def __post_init__(self) -> None:
        """Check the law's name and its parameters."""
        if self.law not in LAWS:
            raise UnknownNameError.of("Device.law", self.law, LAWS)
        law = LAWS[self.law]
        if len(self.values) != len(law.parameters):
            raise ParameterError(
                f"Device.values: expected one CardValue for each of {', '.join(law.parameter_names)}, "
                f"got {len(self.values)}. Give them in this order."
            )
        for name, entry in zip(law.parameter_names, self.values, strict=True):
            check_number(f"{self.name}.{name}", entry.value)
        found = problems(law, self._p)
        if found:
            raise ParameterError(*(f"{self.name}.{name}: {text}" for name, text in found))

    @classmethod
    def load(cls, name_or_path: str | Path) -> Device:
        """Load a shipped card by its name, or any card by its path.

        Raises
        ------
        MissingFileError
            If there is no such card.
        FileFormatError
            If the card breaks a rule.
        """
        card = read_card(name_or_path)
        return cls(name=card.name, law=card.law, source=card.source, values=card.values, data=card.data)

    @staticmethod
    def names() -> list[str]:
        """Names of the shipped cards."""
        return shipped_names()

    def save(self, path: str | Path) -> None:
        """Write the card; the same device always gives the same bytes, those that `sha256` digests."""
        write_atomic(path, self._card_text())

    def replace(self, **parameters: float) -> Device:
        """A copy with other parameter values, in SI; their source is then the caller.

        >>> Device.load("hp_tio2").replace(r_off=32e3).memristance(0.0)
        32000.0

        Raises
        ------
        ParameterError
            If a name is unknown or a value breaks a rule of the law.
        """
        names = LAWS[self.law].parameter_names
        values = dict(zip(names, self.values, strict=True))
        for name, value in parameters.items():
            if name not in values:
                raise UnknownNameError.of(f"{self.name}.replace", name, names)
            number = check_number(f"{self.name}.{name}", value)
            values[name] = CardValue(value=number, source="set by the caller of Device.replace")
        return replace(self, values=tuple(values.values()))

    @property
    def parameters(self) -> dict[str, float]:
        """Parameter values in SI, by name."""
        return dict(zip(LAWS[self.law].parameter_names, self._p, strict=True))

    @property
    def sources(self) -> dict[str, str]:
        """Where each value comes from, by name."""
        return {name: v.source for name, v in zip(self.parameters, self.values, strict=True)}

    @property
    def intervals(self) -> dict[str, tuple[float, float] | None]:
        """Interval of each value as the card states it, by name; None where it states none."""
        return {name: v.interval for name, v in zip(self.parameters, self.values, strict=True)}

    @property
    def charge_scale(self) -> float:
        """q_d [C]: the state charge between the two walls."""
        return float(LAWS[self.law].charge_scale(self._p))

    @property
    def sha256(self) -> str:
        """Digest of the card as `save` writes it."""
        return sha256(self._card_text().encode())

    def conductance(self, s: Any, v: Any = 0.0) -> Any:
        """G(s, v) in S; `s` and `v` broadcast against each other, floats give a float.

        Raises
        ------
        ParameterError
            If `s` is outside [0, 1] or `v` is not finite.
        """
        state, voltage = self._state("s", s), finite(f"{self.name}.conductance: v", v, "V")
        check_size(f"{self.name}.conductance: v", voltage, LARGEST_VOLTAGE, "V")
        try:
            state, voltage = np.broadcast_arrays(state, voltage)
        except ValueError as error:
            raise ParameterError(
                f"{self.name}.conductance: expected s and v of shapes that broadcast, "
                f"got {state.shape} and {voltage.shape}. Give one voltage per state, or a single one."
            ) from error
        return like_input(LAWS[self.law].conductance(state, voltage, self._p))

    def memristance(self, s: Any) -> Any:
        """M = 1/G at vanishing voltage, in Ohm."""
        return 1.0 / self.conductance(s)

    def weight(self, s: Any) -> Any:
        """W = G(s)/G_on, the paper's normalised weight, in [G_off/G_on, 1]."""
        return self.conductance(s) / self.conductance(1.0)

    def state_at_weight(self, w: Any) -> Any:
        """The state whose weight is `w`, an array or a float; exact to rounding.

        >>> round(Device.load("hp_tio2_paper").state_at_weight(0.5), 12)
        0.989898989899

        Raises
        ------
        ParameterError
            If `w` is outside [G_off/G_on, 1].
        """
        low = self.weight(0.0)
        weights = finite(f"{self.name}.state_at_weight: w", w, "")
        outside = (weights < low * (1 - WEIGHT_SLACK)) | (weights > 1 + WEIGHT_SLACK)
        if outside.any():
            raise ParameterError(
                f"{self.name}.state_at_weight: expected {low:.15g} = G_off/G_on <= w <= 1, "
                f"got {weights[outside].flat[0]:.15g}. Choose a weight that the device can hold."
            )
        return like_input(np.vectorize(self._invert, otypes=[float])(np.clip(weights, low, 1.0)))

    def flux(self, s: Any) -> Any:
        """The flux phi in Wb, the integral of the voltage, that takes the state from 0 to `s`; ideal laws only.

        >>> device = Device.load("hp_tio2")
        >>> round(device.state_at_flux(device.flux(0.25)), 12)
        0.25

        Raises
        ------
        ParameterError
            If `s` is outside [0, 1], or the law has no such flux.
        """
        flux, _ = self._ideal("flux")
        return like_input(flux(self._state("s", s), self._p))

    def state_at_flux(self, phi: Any) -> Any:
        """The state to which the flux `phi` in Wb, from 0 to ``flux(1)``, takes the device from s = 0; ideal laws only.

        Raises
        ------
        ParameterError
            If `phi` is outside that range, or the law has no such flux.
        """
        flux, state_at_flux = self._ideal("state_at_flux")
        fluxes, largest = finite(f"{self.name}.state_at_flux: phi", phi, "Wb"), float(flux(1.0, self._p))
        outside = (fluxes < 0.0) | (fluxes > largest * (1.0 + WEIGHT_SLACK))
        if outside.any():
            raise ParameterError(
                f"{self.name}.state_at_flux: phi: expected 0 <= phi <= {largest:.15g} Wb = flux(1), "
                f"got {fluxes[outside].flat[0]:.15g} Wb. Walls hold the flux in this range."
            )
        return like_input(np.clip(state_at_flux(np.minimum(fluxes, largest), self._p), 0.0, 1.0))

    def simulate(
        self, voltage: Any, t: Any, *, s0: float, walls: Walls = "clip", method: Method = "integrate"
    ) -> Trace:
        """Drive the device and follow its state from `s0`.

        ``ds/dt = charge_rate(s, v, i)/q_d``, ``i = G(s, v) v``.

        Parameters
        ----------
        voltage
            Axes (time,) in V, piecewise linear between the times, or a function of the time in s that is
            smooth between them.
        t
            Times in s, axes (time,), strictly increasing, at least two.
        s0
            State at ``t[0]``.
        walls
            ``"clip"``: the state stops exactly at 0 and 1, and leaves when the drive turns. ``"soft"``: it slows down
            before them, over 0.02 of the range, and never arrives; see `walls.soften`.
        method
            ``"integrate"``, to about 1e-9 of the range, 1e-7 where the law is stiff; or ``"closed_form"``, to rounding:
            for ideal laws, sampled voltages and clip walls.

        Raises
        ------
        ParameterError
            If an input breaks these rules.
        OperationError
            If the integration fails.
        """
        from ohmloom.devices.simulate import METHODS, follow_flux, integrate, sign_changes

        where = f"{self.name}.simulate"
        for field, value, known in (("walls", walls, WALLS), ("method", method, METHODS)):
            expect_type(f"{where}: {field}", value, str, name="a name")
            if value not in known:
                raise UnknownNameError.of(f"{where}: {field}", value, known)
        times = rising_times(where, t)
        start = float(self._state("s0", s0, ndim=0))
        drive = drive_over(where, voltage, times)
        v = np.array([drive(time) for time in times.tolist()])
        law, is_function = LAWS[self.law], callable(voltage)
        if method == "closed_form":
            self._ideal("simulate: method", "closed_form needs one")
            for refused, given in ((is_function, "a function as voltage"), (walls == "soft", "soft walls")):
                if refused:
                    raise ParameterError(
                        f"{where}: method: expected a sampled voltage and clip walls for closed_form, got {given}. "
                        "Use method='integrate'."
                    )
            s = follow_flux(law, self._p, v, times, start)
        else:
            s = integrate(law, self._p, drive, times, start, walls, None if is_function else sign_changes(times, v))
        return Trace(
            t=times,
            v=v,
            i=self.conductance(s, v) * v,
            q=s * self.charge_scale,
            s=s,
            provenance=self._provenance(start, walls, method),
        )

    def emit(self, to: str) -> str:
        """The device as text for other tools, from the same definition of the law.

        Parameters
        ----------
        to
            ``"c"``: C99 functions. ``"spice"``: an ngspice subcircuit ``p n`` with the state `s0` and all parameters
            settable per instance. ``"verilog-a"``: a module with ports p, n.

        Examples
        --------
        >>> print(Device.load("linear").emit("spice").splitlines()[-1])
        .ends linear

        Raises
        ------
        ParameterError
            If there is no such language, or a parameter's name is taken in one of them.
        OperationError
            If the law uses an operation that these languages lack.
        """
        from ohmloom.devices.emit import emit

        return emit(self, to)

    @property
    def _p(self) -> tuple[float, ...]:
        return tuple(entry.value for entry in self.values)

    def _card_text(self) -> str:
        card = Card(name=self.name, law=self.law, source=self.source, values=self.values, data=self.data)
        return write_card(card)

    def _invert(self, w: float) -> float:
        from scipy.optimize import brentq

        law, p = LAWS[self.law], self._p
        wanted = w * law.conductance(1.0, 0.0, p)
        if wanted <= law.conductance(0.0, 0.0, p):
            return 0.0
        return float(brentq(lambda s: law.conductance(s, 0.0, p) - wanted, 0.0, 1.0, xtol=1e-18, rtol=8.9e-16))

    def _state(self, field: str, s: Any, ndim: int | None = None) -> FloatArray:
        where = f"{self.name}: {field}"
        state = finite(where, s, "")
        if ndim is not None and state.ndim != ndim:
            raise ParameterError(f"{where}: expected a single state, got shape {state.shape}. Give one number.")
        outside = (state < 0.0) | (state > 1.0)
        if outside.any():
            raise ParameterError(
                f"{where}: expected 0 <= {field} <= 1, got {state[outside].flat[0]:.15g}. "
                f"Divide a charge by charge_scale = {self.charge_scale:.6g} C."
            )
        return state

    def _ideal(self, field: str, need: str = "only an ideal one has a flux") -> tuple[Any, Any]:
        """The law's `flux` and `state_at_flux`."""
        law = LAWS[self.law]
        if law.flux is None or law.state_at_flux is None:
            ideal = ", ".join(name for name, other in LAWS.items() if other.is_ideal)
            raise ParameterError(
                f"{self.name}.{field}: expected an ideal law (dq/dt = i, G a function of s alone): {need}, got "
                f"{self.law}. Use one of {ideal}, or simulate with method='integrate'."
            )
        return law.flux, law.state_at_flux

    def _provenance(self, s0: float, walls: str, method: str) -> str:
        from importlib.metadata import version

        made = {
            "ohmloom": version("ohmloom"),
            "device": self.name,
            "law": self.law,
            "parameters": self.parameters,
            "device_sha256": self.sha256,
            "s0": s0,
            "walls": walls,
            "method": method,
        }
        return json.dumps(made, sort_keys=True)

    def _repr_html_(self) -> str:
        units = {parameter.name: parameter.unit for parameter in LAWS[self.law].parameters}
        rows = [("name", self.name, ""), ("law", self.law, LAWS[self.law].doc)]
        rows += [(k, format_quantity(v, units[k]), self.sources[k]) for k, v in self.parameters.items()]
        cells = "".join(
            f"<tr><th>{html.escape(a)}</th><td>{html.escape(b)}</td><td>{html.escape(c)}</td></tr>" for a, b, c in rows
        )
        return f"<table>{cells}</table>"
