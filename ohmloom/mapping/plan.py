"""A plan: which neuron sits on which line of which tile, and which synapse on which crosspoint."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ohmloom import __version__
from ohmloom._files import StrictModel, check_format, parse_json, read_bytes, validate, write_atomic
from ohmloom.errors import FileFormatError, MappingError, shown
from ohmloom.mapping.hardware import Hardware
from ohmloom.neurocontroller import Network

FORMAT, VERSION = "ohmloom.plan", 1


class _PlanFile(StrictModel):
    """The keys of a plan's file; what is in them must be what `place` gives again."""

    ohmloom: str
    hardware_sha256: str
    tiles: list[Any]
    crosspoints: list[Any]
    network: dict[str, Any]
    hardware: dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class ReadErrors:
    """Worst read error of a tile, as a fraction of the read voltage: all rows driven, every plastic device at G_on.

    Attributes
    ----------
    given, sorted, refined
        With the lines in ascending order, after sorting them by current, and after swaps, all without spare lines.
    built
        With the last order and the spare lines, whose wires all currents pass.
    swaps
        How many swaps were made.
    limit
        What the size of the tile was chosen for; `built` is above it only where no size helps.
    """

    given: float
    sorted: float
    refined: float
    built: float
    swaps: int
    limit: float

    @property
    def gain(self) -> float:
        """Part of the error that the order of the lines takes away."""
        return 1.0 - self.refined / self.given if self.given > 0.0 else 0.0


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
        Further lines without a neuron, for repair: after the last row, and between the last column and the reference.
    is_differential
        Whether each synapse has a second device at G_off, on the line of the same receiver with the other sign.
    read_error
        Of the lines in this order; None in a tile made by hand.
    """

    kind: str
    card: str
    rows: tuple[int, ...]
    columns: tuple[int, ...]
    has_reference: bool
    column_signs: tuple[int, ...] = ()
    spare_rows: int = 0
    spare_columns: int = 0
    is_differential: bool = False
    read_error: ReadErrors | None = None

    def __post_init__(self) -> None:
        if not self.column_signs:
            object.__setattr__(self, "column_signs", (1,) * len(self.columns))

    @property
    def subtracts_off(self) -> bool:
        """Whether G_off is subtracted, so that ``W = (G - G_off)/(G_on - G_off)``; else ``W = G/G_on``."""
        return self.has_reference or self.is_differential

    @property
    def name(self) -> str:
        """Kind and size, for people."""
        return f"{self.kind} {len(self.rows)} x {len(self.columns)}"


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

    def tile_gain(self, t: int) -> float:
        """What a tile's senses multiply a current by, so that a synapse of W = 1 counts as 1 [1/A].

        It is 1/(V_read (G_on - reference)), and makes tiles of other kinds of device add up in one membrane.
        """
        tile, device = self.tiles[t], self.hardware.devices[self.tiles[t].kind]
        span = float(device.conductance(1.0)) - (float(device.conductance(0.0)) if tile.subtracts_off else 0.0)
        return 1.0 / (self.hardware.read.voltage.value * span)

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
                "read_polarity": point.polarity, "column_sign": tile.column_signs[point.column],
                "tap_steps": point.tap, "weight": synapse.weight,
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
        """Read what `save` wrote; the lines are taken from the file, all else must follow from them.

        Raises
        ------
        FileFormatError
            If the file is not a plan, or its tiles disagree with its network and hardware.
        """
        from ohmloom.mapping.placing import check_tiles, crosspoints

        data, where = read_bytes(path, "plan"), str(path)
        table = check_format(parse_json(data, where), where, FORMAT, VERSION)
        validate(_PlanFile, table, where)
        network = Network.from_json(json.dumps(table["network"]).encode(), f"{where}: network")
        hardware = Hardware._from_table(table["hardware"], f"{where}: hardware")
        try:
            tiles = tuple(_tile(entry) for entry in table["tiles"])
            check_tiles(network, hardware, tiles)
            points = crosspoints(network, hardware, tiles)
        except (MappingError, TypeError, KeyError, ValueError, AttributeError) as error:
            raise FileFormatError(f"{where}: tiles: expected those that carry this network, got a mistake: "
                                  f"{shown(str(error), 200)}. Make the plan again.") from error  # fmt: skip
        plan = cls(network=network, hardware=hardware, tiles=tiles, crosspoints=points)
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


def _tile(entry: dict[str, Any]) -> Tile:
    error = entry.get("read_error")
    lists = {name: tuple(int(x) for x in entry[name]) for name in ("rows", "columns", "column_signs")}
    return Tile(**{**entry, **lists, "read_error": None if error is None else ReadErrors(**error)})
