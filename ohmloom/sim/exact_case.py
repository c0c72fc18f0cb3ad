"""What an entry of the exact box looks at: a plan, a trial, and the same cards on hardware that can be exact."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

from ohmloom.devices import LAWS, Device
from ohmloom.mapping import Hardware, Plan
from ohmloom.neurocontroller import Network
from ohmloom.neurocontroller.kinds import PLASTIC_KINDS
from ohmloom.neurocontroller.plain import stdp_sign
from ohmloom.sim.agreement import Agreement, agreement
from ohmloom.sim.arena import Arena

NO_PLASTIC = "no plastic synapse"
Rule = Callable[[int, int, int], int]


@dataclass(frozen=True, kw_only=True)
class Case:
    """A plan and how it is checked.

    Attributes
    ----------
    plan
        Network and hardware.
    trial_key, arena
        The trial that networks are compared in.
    perturb
        Relative error of every event's charge; 0 is right.
    integrate
        Whether networks follow the devices' differential equations, and not their closed forms.
    rule
        ``rule(ls_pre, ls_post, stdp_threshold)``: eqs. 10 and 11, or another to see the box turn red.
    """

    plan: Plan
    trial_key: int
    arena: Arena
    perturb: float = 0.0
    integrate: bool = False
    rule: Rule = stdp_sign

    @property
    def hardware(self) -> Hardware:
        """The spec."""
        return self.plan.hardware

    @property
    def network(self) -> Network:
        """The network."""
        return self.plan.network

    @property
    def plastic(self) -> dict[str, Device]:
        """Cards of the plastic kinds that the network uses."""
        used = {tile.kind for tile in self.plan.tiles}
        return {kind: d for kind, d in self.hardware.devices.items() if kind in used and kind in PLASTIC_KINDS}

    @property
    def not_ideal(self) -> list[str]:
        """Plastic kinds whose law has no flux: nothing about them is claimed to be exact."""
        return [kind for kind, device in self.plastic.items() if LAWS[device.law].flux is None]

    @cached_property
    def charge(self) -> Agreement:
        """Charge-exact drive on selected cells without wires, beside the discrete model of the spec's cards."""
        return self._network("charge_metered", "cards")

    @cached_property
    def flux(self) -> Agreement:
        """Pulses of fixed voltage without wires, beside the flux-discrete model of the same cards."""
        return self._network("voltage", "flux")

    def _network(self, mode: str, model: Literal["cards", "flux"]) -> Agreement:
        return agreement(
            self.network, exact_variant(self.hardware, mode), arena=self.arena, perturb=self.perturb,
            trial_key=self.trial_key, model=model, integrate=self.integrate, as_wired=not self.hardware.wires.is_ideal,
        )  # fmt: skip


def exact_variant(hardware: Hardware, mode: str) -> Hardware:
    """The same cards and waveform on selected cells without wires, whose events are written in another mode."""
    zero = hardware.wires.r_row.model_copy(update={"value": 0.0})
    wires = hardware.wires.model_copy(update={"r_row": zero, "r_column": zero, "r_driver": None, "r_sense": None})
    array = hardware.array.model_copy(
        update={"access": "1T1R", "disabled": "masked", "unformed_conductance": None, "signs": "row_polarity"}
    )
    keep = {} if mode == hardware.drive.mode == "voltage" else {"pulse_duration": None}
    # The exactness is of pulses, not of what a slot cuts off them, nor of what a driver can carry.
    drive = hardware.drive.model_copy(
        update={"mode": mode, "parallelism": "column", "pulse_shape": "rectangular", "edge": None, "slot": None,
                "compliance_current": None, "compliance_voltage": None, **keep}
    )  # fmt: skip
    return hardware.model_copy(update={"wires": wires, "array": array, "drive": drive})


def not_claimed(case: Case) -> str | None:
    if case.not_ideal:
        laws = ", ".join(f"{kind} ({case.plastic[kind].law})" for kind in case.not_ideal)
        return f"{laws}: the state is not moved by the current alone, so no exactness is claimed"
    return None
