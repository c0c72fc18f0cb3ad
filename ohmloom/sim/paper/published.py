"""What the paper prints, as numbers."""

from __future__ import annotations

from functools import cache
from importlib import resources
from typing import Any

from ohmloom._files import StrictModel, check_format, parse_toml, validate

FORMAT, VERSION = "ohmloom.published", 1
Table = dict[str, dict[str, float]]


class Published(StrictModel):
    """Numbers of the paper; see the head of each table in ``published.toml``.

    Attributes
    ----------
    means
        task -> measure -> system -> [mean, standard deviation].
    tests, counts
        task -> measure or place -> "A-B" -> p of a t-test; 0.001 stands for "< 0.001".
    numbers
        task -> place -> kind -> mean number of synapses.
    activity
        task -> quantity -> kind -> value.
    turn
        sign -> kind -> events per timestep on entering the turn, in it, at its end, after it.
    implied_success
        system -> P(one random network solves).
    """

    format: str
    version: int
    means: dict[str, dict[str, dict[str, list[float]]]]
    tests: dict[str, Table]
    counts: dict[str, Table]
    numbers: dict[str, Table]
    activity: dict[str, Table]
    turn: dict[str, dict[str, list[str]]]
    implied_success: dict[str, float]


@cache
def published() -> Published:
    """Read the shipped file."""
    path = resources.files("ohmloom.sim.paper") / "published.toml"
    table: dict[str, Any] = parse_toml(path.read_bytes(), str(path))
    check_format(table, str(path), FORMAT, VERSION)
    return validate(Published, table, str(path))
