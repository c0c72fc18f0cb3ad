"""A plan: which neuron sits on which line of which tile, and which synapse on which crosspoint."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ohmloom import __version__
from ohmloom._files import StrictModel, check_format, parse_json, read_bytes, validate, write_atomic
from ohmloom.devices import Device
from ohmloom.errors import FileFormatError, MappingError, expect_type
from ohmloom.mapping.hardware import Hardware
from ohmloom.mapping.waveform import check_rule
from ohmloom.neurocontroller import KINDS, Network
from ohmloom.neurocontroller.device_levels import lowest_weight, state_of_weight
from ohmloom.neurocontroller.kinds import reads_with_reference as reads_with_reference

FORMAT, VERSION = "ohmloom.plan", 1
WEIGHT_TOLERANCE = 1e-9  # rounding of G_off/G_on against a weight of exactly that size


class _PlanFile(StrictModel):
    """The keys of a plan's file; what is in them must be what `place` gives again."""

    ohmloom: str
    hardware_sha256: str
    tiles: list[Any]
    crosspoints: list[Any]
    network: dict[str, Any]
    hardware: dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class Tile:
    """One array of devices of one kind.

    Attributes
    ----------
    kind, card
        Kind of synapse and the device card that builds it.
    rows, columns
        Sending neuron on each word line, from the one farthest from the senses; receiving neuron on each bit line, from
        the one nearest to the drivers.
    has_reference
        Whether a column of devices at G_off, after the last bit line, is subtracted, so that W = 0 can be read.
    column_signs
        What each bit line counts as: 1, or -1 for the negative line of a pair.
    spare_rows, spare_columns
        Further lines without a neuron, for repair.
    """

    kind: str
    card: str
    rows: tuple[int, ...]
    columns: tuple[int, ...]
    has_reference: bool
    column_signs: tuple[int, ...] = ()
    spare_rows: int = 0
    spare_columns: int = 0

    def __post_init__(self) -> None:
        if not self.column_signs:
            object.__setattr__(self, "column_signs", (1,) * len(self.columns))


@dataclass(frozen=True, kw_only=True)
class Crosspoint:
    """One synapse on its device.

    Attributes
    ----------
    synapse, tile, row, column
        Index of the synapse in the network, of the tile, of the word line and of the bit line.
    polarity
        Sign of the row's read voltage times that of its bit line: -1 for an inhibitory sender.
    tap
        Shift-register tap of the row while this column is read, in steps (eq. 5).
    state, conductance
        Initial state s in [0, 1] and conductance [S].
    """

    synapse: int
    tile: int
    row: int
    column: int
    polarity: int
    tap: int
    state: float
    conductance: float


@dataclass(frozen=True, kw_only=True)
class Plan:
    """A network placed on hardware."""

    network: Network
    hardware: Hardware
    tiles: tuple[Tile, ...]
    crosspoints: tuple[Crosspoint, ...]

    def sample(self, *, seed: int, die: int = 0) -> Any:
        """One piece of hardware with its sampled spreads; see `ohmloom.mapping.Die`."""
        from ohmloom.mapping.die import sample

        return sample(self, seed=seed, die=die)

    def nominal(self) -> Any:
        """The piece of hardware in which every device is as its card says."""
        from ohmloom.mapping.die import nominal

        return nominal(self)

    def table(self) -> list[dict[str, Any]]:
        """One row a synapse: which device, which lines, which conductance. Units in the column names."""
        labels = self.network.labels()
        rows = []
        for point in self.crosspoints:
            tile, synapse = self.tiles[point.tile], self.network.synapses[point.synapse]
            rows.append({
                "synapse": point.synapse, "kind": tile.kind, "card": tile.card, "tile": point.tile,
                "row": point.row, "column": point.column, "pre": synapse.pre, "post": synapse.post,
                "sender": labels[synapse.pre], "receiver": labels[synapse.post],
                "read_polarity": point.polarity, "tap_steps": point.tap, "weight": synapse.weight,
                "state": point.state, "conductance_S": point.conductance,
            })  # fmt: skip
        return rows

    def to_json(self) -> str:
        """The plan with its network and hardware spec."""
        table: dict[str, Any] = {"format": FORMAT, "version": VERSION, "ohmloom": __version__}
        table["hardware_sha256"] = self.hardware.sha256
        table |= {"tiles": [asdict(t) for t in self.tiles], "crosspoints": [asdict(c) for c in self.crosspoints]}
        table["network"] = json.loads(self.network.to_json())
        table["hardware"] = self.hardware.model_dump()
        return json.dumps(table, indent=1) + "\n"

    def save(self, path: Path | str) -> None:
        """Write ``plan.json``, whole or not at all."""
        write_atomic(path, self.to_json())

    @classmethod
    def load(cls, path: Path | str) -> Plan:
        """Read what `save` wrote; the placement is made again and must be the same.

        Raises
        ------
        FileFormatError
            If the file is not a plan, or its tiles disagree with its network and hardware.
        """
        data, where = read_bytes(path, "plan"), str(path)
        table = check_format(parse_json(data, where), where, FORMAT, VERSION)
        validate(_PlanFile, table, where)
        network = Network.from_json(json.dumps(table["network"]).encode(), f"{where}: network")
        plan = place(network, Hardware._from_table(table["hardware"], f"{where}: hardware"))
        again = json.loads(plan.to_json())
        for key in ("hardware_sha256", "tiles", "crosspoints"):
            if again[key] != table[key]:
                raise FileFormatError(f"{where}: {key}: expected what this network and hardware give, "
                                      "got something else. Make the plan again.")  # fmt: skip
        return plan

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><td>{t.kind}</td><td>{t.card}</td><td>{len(t.rows)} x {len(t.columns)}</td></tr>" for t in self.tiles
        )
        return f"<table><tr><th>kind</th><th>card</th><th>rows x columns</th></tr>{rows}</table>"


def place(network: Network, hardware: Hardware) -> Plan:
    """Place every synapse of `network` on a device of its kind.

    Rows are senders and columns receivers, both in ascending order; one tile a kind; the sender's sign is the read
    polarity of its row; lateral delays are taps of the row's shift register while the column is read.

    Raises
    ------
    MappingError
        Names the kind without a card, the synapse that its device cannot hold, the tile that does not fit, or the
        reading that this hardware cannot follow.
    ParameterError
        If `network` or `hardware` is of another type.
    """
    expect_type("place.network", network, Network)
    expect_type("place.hardware", hardware, Hardware)
    _check_readings(network, hardware)
    _check_kinds(network, hardware)
    kinds = [kind for kind in KINDS if any(s.kind == kind for s in network.synapses)]
    tiles = tuple(_tile(network, hardware, kind) for kind in kinds)
    devices = hardware.devices
    crosspoints = []
    for k, synapse in enumerate(network.synapses):
        index = kinds.index(synapse.kind)
        tile, device = tiles[index], devices[synapse.kind]
        state = _initial_state(network, device, k)
        point = Crosspoint(
            synapse=k, tile=index, row=tile.rows.index(synapse.pre), column=tile.columns.index(synapse.post),
            polarity=int(network.sign(synapse.pre)), tap=network.delay(synapse), state=state,
            conductance=float(device.conductance(state)),
        )  # fmt: skip
        crosspoints.append(point)
    return Plan(network=network, hardware=hardware, tiles=tiles, crosspoints=tuple(crosspoints))


def _check_readings(network: Network, hardware: Hardware) -> None:
    readings = network.readings
    if readings.weight_at != "arrival":
        raise MappingError(f"{network.name}: readings.weight_at: expected 'arrival', got {readings.weight_at!r}. "
                           "A column is read when the spike arrives; evolve with weight_at = 'arrival'.")  # fmt: skip
    if any(s.kind != "constant" for s in network.synapses):
        check_rule(hardware.drive.volts, hardware.drive.threshold.value, readings)


def _check_kinds(network: Network, hardware: Hardware) -> None:
    problems = []
    for kind in KINDS:
        users = [k for k, s in enumerate(network.synapses) if s.kind == kind]
        if users and kind not in hardware.cards:
            synapse = network.synapses[users[0]]
            problems.append(
                f"{hardware.name}: cards.{kind}: expected a device card, got none, but {len(users)} synapses of "
                f"{network.name} need one, first synapses[{users[0]}] ({synapse.pre} -> {synapse.post}). "
                f"Add a card for {kind}, or use a spec that has one."
            )
    if problems:
        raise MappingError(*problems)


def _tile(network: Network, hardware: Hardware, kind: str) -> Tile:
    members = [s for s in network.synapses if s.kind == kind]
    rows, columns = sorted({s.pre for s in members}), sorted({s.post for s in members})
    has_reference = reads_with_reference(kind)
    for name, lines, limit in (
        ("max_rows", rows, hardware.array.max_rows),
        ("max_columns", [*columns, *([-1] if has_reference else [])], hardware.array.max_columns),
    ):
        if len(lines) > limit:
            of_kind = (k for k, s in enumerate(network.synapses) if s.kind == kind)
            first_out = next(k for k in of_kind if _is_beyond(network.synapses[k], lines, limit, name))
            raise MappingError(f"{hardware.name}: array.{name}: expected at least {len(lines)} for the {kind} tile of "
                               f"{network.name}, got {limit}; synapses[{first_out}] is the first without a line. "
                               "Enlarge the array.")  # fmt: skip
    return Tile(
        kind=kind, card=hardware.cards[kind], rows=tuple(rows), columns=tuple(columns), has_reference=has_reference
    )


def _is_beyond(synapse: Any, lines: Sequence[int], limit: int, name: str) -> bool:
    neuron = synapse.pre if name == "max_rows" else synapse.post
    # The reference column comes last, so it is the last receiver that has to make room for it.
    return lines.index(neuron) >= limit - (1 if lines[-1] == -1 else 0)


def _initial_state(network: Network, device: Device, k: int) -> float:
    synapse = network.synapses[k]
    has_reference = reads_with_reference(synapse.kind)
    lowest = lowest_weight(device, has_reference=has_reference)
    if synapse.weight < lowest * (1.0 - WEIGHT_TOLERANCE):
        raise MappingError(
            f"{network.name}: synapses[{k}].weight: expected at least G_off/G_on = {lowest:g} of the card "
            f"{device.name!r}, got {synapse.weight}. Use a card with a larger ratio."
        )
    return state_of_weight(device, synapse.weight, has_reference=has_reference)
