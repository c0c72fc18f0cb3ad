"""Plastic synapses on device cards: states counted in events, and the levels of weight that they can have.

A state is an origin and a count of events since (see ``devices/_event_kernels.py``). At a wall the origin becomes the
wall, so a kind has three families of levels: counted from the start, from the bottom and from the top.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom.devices import LAWS, Device
from ohmloom.errors import ParameterError, UnknownNameError, expect_number, expect_type, shown
from ohmloom.neurocontroller.kinds import INITIAL_WEIGHT, KINDS, MEM_LIFETIME, PLASTIC_KINDS, reads_with_reference
from ohmloom.neurocontroller.network import Network

PAPER_CARDS = {"hp": "hp_tio2_paper", "peo_pani": "peo_pani_paper", "linear": "linear_paper"}
MOST_EVENTS = 200_000  # from wall to wall: tables of three families and kinds then stay below 30 MB
WHERE = "SpikingController"


def lowest_weight(device: Device, *, has_reference: bool) -> float:
    """Read weight at s = 0: 0 against a reference at G_off, else G_off/G_on."""
    return 0.0 if has_reference else float(device.conductance(0.0) / device.conductance(1.0))


@lru_cache(maxsize=4096)  # a plan asks for one start many times
def state_of_weight(device: Device, weight: float, *, has_reference: bool) -> float:
    """The state at which the read weight is `weight`, or the wall that is nearest to it.

    W = (G - G_off)/(G_on - G_off) against a reference, else W = G/G_on.
    """
    g_on, g_off = float(device.conductance(1.0)), float(device.conductance(0.0))
    wanted = weight * (g_on - g_off) + g_off if has_reference else weight * g_on
    return float(device.state_at_weight(min(max(wanted / g_on, g_off / g_on), 1.0)))


@dataclass(frozen=True, kw_only=True)
class DeviceEvents:
    """One plastic kind on a device card, moved by whole events.

    Attributes
    ----------
    law, parameters
        The device's, the values in declared order.
    has_reference
        Whether G_off is subtracted when the weight is read.
    first_state
        s at the start of a trial.
    event_flux
        Flux of one event in Wb; None for events of charge, q_d/1000 each.
    """

    law: str
    parameters: tuple[float, ...]
    has_reference: bool
    first_state: float
    event_flux: float | None

    @cached_property
    def start(self) -> tuple[float, float]:
        """Origin and count at the start."""
        from ohmloom.devices import _kernels

        law, _, _, p, bottom, top = self._device
        origin = self.first_state if self.event_flux is None else float(_kernels.flux(law, self.first_state, p))
        # A start at a wall counts from the wall, whatever the rounding of its flux.
        return (bottom if self.first_state <= 0.0 else top if self.first_state >= 1.0 else origin), 0.0

    def moved(self, state: tuple[float, float], sign: int) -> tuple[float, float]:
        """Origin and count after one event, positive or negative."""
        from ohmloom.devices import _event_kernels

        law, family, event_flux, p, bottom, top = self._device
        _, origin, count = _event_kernels.event_state(
            law, family, state[0], state[1] + sign, event_flux, p, bottom, top
        )
        return origin, count

    def weight(self, state: tuple[float, float]) -> float:
        """Read weight in [0, 1] of an origin and count."""
        from ohmloom.devices import _event_kernels, _kernels

        law, family, event_flux, p, bottom, top = self._device
        s, _, _ = _event_kernels.event_state(law, family, *state, event_flux, p, bottom, top)
        return float(_event_kernels.read_weight(_kernels.conductance(law, s, 0.0, p), *self._scale))

    @property
    def levels(self) -> Levels:
        """All weights that events reach, and the way from one to the next."""
        return _levels(self)

    @cached_property
    def _device(self) -> tuple[int, int, float, FloatArray, float, float]:
        """Law, family, flux of an event, parameters and the two walls, as the kernels take them."""
        from ohmloom.devices import _event_kernels, _kernels

        law, p = _kernels.LAW_INDEX[self.law], np.array(self.parameters)
        if self.event_flux is None:
            return law, _event_kernels.CHARGE, 0.0, p, 0.0, 1.0
        walls = float(_kernels.flux(law, 0.0, p)), float(_kernels.flux(law, 1.0, p))
        return law, _event_kernels.FLUX, self.event_flux, p, *walls

    @cached_property
    def _scale(self) -> tuple[float, float]:
        """Conductances at which the weight is 0 (that of no device, without a reference) and 1."""
        from ohmloom.devices import _kernels

        law, p = _kernels.LAW_INDEX[self.law], np.array(self.parameters)
        return float(_kernels.conductance(law, 0.0, 0.0, p)) if self.has_reference else 0.0, float(
            _kernels.conductance(law, 1.0, 0.0, p)
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Levels:
    """Weights of one kind and, for each, the index of the weight after an event; axes (level,)."""

    weights: FloatArray
    up: np.ndarray
    down: np.ndarray
    start: int


@lru_cache(maxsize=16)
def _levels(events: DeviceEvents) -> Levels:
    from ohmloom.neurocontroller import _level_kernels

    law, family, event_flux, p, bottom, top = events._device
    room = int((top - bottom) / (event_flux or 1.0 / MEM_LIFETIME)) + 3

    def follow(origin: float, sign: float) -> FloatArray:
        weights = np.empty(room)
        count = _level_kernels.follow(law, family, origin, sign, event_flux, p, bottom, top, *events._scale, weights)
        return weights[:count]

    origin, _ = events.start
    inner = np.empty(0)
    below = 0
    if bottom < origin < top:
        falling, rising = follow(origin, -1.0), follow(origin, 1.0)
        inner, below = np.concatenate([falling[:0:-1], rising]), len(falling) - 1
    from_bottom, from_top = follow(bottom, 1.0), follow(top, -1.0)
    at_bottom = len(inner)
    at_top = at_bottom + len(from_bottom)
    levels = np.arange(at_top + len(from_top), dtype=np.int32)
    # Counts rise with the level, but for those from the top, which are negative.
    up, down = levels + 1, levels - 1
    up[at_top:], down[at_top:] = levels[at_top:] - 1, levels[at_top:] + 1
    if len(inner):
        up[at_bottom - 1], down[0] = at_top, at_bottom
    up[at_top - 1], down[at_bottom] = at_top, at_bottom
    up[at_top], down[-1] = at_top, at_bottom
    start = below if len(inner) else at_top if origin >= top else at_bottom
    return Levels(weights=np.concatenate([inner, from_bottom, from_top]), up=up, down=down, start=start)


def events_of(network: Network, plasticity: str, cards: Any, event_flux: Any) -> dict[str, DeviceEvents]:
    """The events of a network's plastic kinds on `cards`, checked; see `SpikingController`."""
    is_flux = plasticity == "flux"
    devices = _checked_cards(cards) if cards is not None else {k: Device.load(v) for k, v in PAPER_CARDS.items()}
    fluxes = _checked_fluxes(event_flux, is_flux)
    found = {}
    for kind in PLASTIC_KINDS:
        if all(synapse.kind != kind for synapse in network.synapses):
            continue
        if kind not in devices:
            raise ParameterError(f"{WHERE}.cards: expected a card for every plastic kind of the network, got none for "
                                 f"{kind!r}. Add it.")  # fmt: skip
        found[kind] = _events(kind, devices[kind], is_flux, fluxes.get(kind))
    return found


def _checked_cards(cards: Any) -> dict[str, Device]:
    expect_type(f"{WHERE}.cards", cards, Mapping, name="a table of kinds and devices")
    for kind, device in cards.items():
        if kind not in KINDS:
            raise UnknownNameError.of(f"{WHERE}.cards", kind, KINDS)
        expect_type(f"{WHERE}.cards[{kind!r}]", device, Device)
    return dict(cards)


def _checked_fluxes(event_flux: Any, is_flux: bool) -> dict[str, float]:
    if event_flux is None:
        return {}
    if not is_flux:
        raise ParameterError(f"{WHERE}.event_flux: expected None with plasticity = 'charge', got {shown(event_flux)}. "
                             "Use plasticity='flux', or leave it out.")  # fmt: skip
    expect_type(f"{WHERE}.event_flux", event_flux, Mapping, name="a table of kinds and fluxes in Wb")
    checked = {}
    for kind, value in event_flux.items():
        if kind not in PLASTIC_KINDS:
            raise UnknownNameError.of(f"{WHERE}.event_flux", kind, PLASTIC_KINDS)
        where = f"{WHERE}.event_flux[{kind!r}]"
        checked[kind] = expect_number(where, value, "a flux > 0 Wb")
        if checked[kind] <= 0.0:
            raise ParameterError(f"{where}: expected a flux > 0 Wb, got {shown(value)}. A negative event has the same "
                                 "size; give that.")  # fmt: skip
    return checked


def _events(kind: str, device: Device, is_flux: bool, event_flux: float | None) -> DeviceEvents:
    where, has_reference = f"{WHERE}.cards[{kind!r}]", reads_with_reference(kind)
    lowest = lowest_weight(device, has_reference=has_reference)
    if lowest > INITIAL_WEIGHT:
        raise ParameterError(f"{where}: expected G_off/G_on <= {INITIAL_WEIGHT}, the weight at the start, got "
                             f"{lowest:g} of the card {device.name!r}. Use a card with a larger ratio.")  # fmt: skip
    if is_flux and LAWS[device.law].flux is None:
        ideal = ", ".join(name for name, law in LAWS.items() if law.flux is not None)
        raise ParameterError(f"{where}: expected a law that has a flux ({ideal}), got {device.law!r} of the card "
                             f"{device.name!r}. Use another card, or plasticity='charge'.")  # fmt: skip
    s = state_of_weight(device, INITIAL_WEIGHT, has_reference=has_reference)
    if is_flux:
        # Right at the start, where the conductance is G(s): it then moves the charge by q_d/1000, to first order.
        is_default = event_flux is None
        event_flux = event_flux or device.charge_scale / MEM_LIFETIME / float(device.conductance(s))
        crossing = float(device.flux(1.0)) / event_flux
        if not crossing <= MOST_EVENTS:
            which = "default, q_d/1000/G at W = 0.5" if is_default else "given flux"
            raise ParameterError(f"{WHERE}.event_flux[{kind!r}]: expected a flux that crosses the range of the card "
                                 f"{device.name!r} in at most {MOST_EVENTS} events, got {event_flux:g} Wb ({which}), "
                                 f"which takes {crossing:.3g}. Give a larger flux.")  # fmt: skip
    return DeviceEvents(
        law=device.law, parameters=tuple(device.parameters.values()), has_reference=has_reference, first_state=s,
        event_flux=event_flux if is_flux else None,
    )  # fmt: skip
