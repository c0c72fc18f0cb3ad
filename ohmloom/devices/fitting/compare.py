"""Several laws on the same sweeps: which one to believe."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pydantic

from ohmloom._files import StrictModel, advise, check_format, parse_json, read_bytes, validate, write_atomic
from ohmloom.devices.fitting._checks import Weights, check_inputs, check_names, sizes
from ohmloom.devices.fitting._coordinates import choose
from ohmloom.devices.fitting.fit import check_count, fit
from ohmloom.devices.fitting.result import LARGEST_FILE, Fit
from ohmloom.devices.measurement import Measurement
from ohmloom.errors import FileFormatError, ParameterError, expect_type

FORMAT, VERSION = "ohmloom.comparison", 1
FEW_POINTS = 3.0  # effective points for each unknown, under which BIC says little
USELESS_HOLDOUT = 0.25


class Ranked(StrictModel):
    """One law in a comparison.

    ``unknowns``: fitted parameters and start states; ``bic``: on the effective points of the law that fits best, the
    same number for all, less the smallest; ``holdout_rms``: relative RMS on the sweeps held out, or None.
    """

    law: str
    unknowns: int
    relative_rms: float
    delta_bic: float
    holdout_rms: float | None


class Comparison(StrictModel):
    """Laws ranked, and their fits.

    ``ranking`` is by BIC, best first; ``by_holdout`` names the laws by their error on the sweeps held out, best
    first, empty without any. Where the two disagree, believe the hold-out.
    """

    n_eff: float
    ranking: Annotated[tuple[Ranked, ...], pydantic.Strict(False)]
    by_holdout: Annotated[tuple[str, ...], pydantic.Strict(False)]
    fits: dict[str, Fit]

    def save(self, path: str | Path) -> None:
        """Write everything as JSON; the same comparison always gives the same bytes."""
        table = {"format": FORMAT, "version": VERSION, **self.model_dump(mode="json")}
        write_atomic(path, json.dumps(table, indent=1, allow_nan=False) + "\n")

    @classmethod
    def load(cls, path: str | Path) -> Comparison:
        """Read what `save` wrote.

        Raises
        ------
        MissingFileError
            If the file does not exist.
        FileFormatError
            If it is damaged or no comparison.
        """
        where = str(path)
        table = parse_json(read_bytes(path, "comparison", limit=LARGEST_FILE), where)
        try:
            return validate(cls, check_format(table, where, FORMAT, VERSION), where)
        except FileFormatError as error:
            raise FileFormatError(*advise(error.problems, "Compare again.")) from error

    def summary(self) -> str:
        """The ranking as a table for a terminal."""
        lines = [f"{'law':18}{'unknowns':>9}{'relative RMS':>14}{'delta BIC':>11}{'held out':>10}"]
        for row in self.ranking:
            held_out = "-" if row.holdout_rms is None else f"{row.holdout_rms:.4f}"
            lines.append(f"{row.law:18}{row.unknowns:9}{row.relative_rms:14.4f}{row.delta_bic:11.1f}{held_out:>10}")
        return "\n".join([*lines, *self.remarks()])

    def remarks(self) -> list[str]:
        """What a reader of the ranking must know, as sentences."""
        found = []
        if self.n_eff < FEW_POINTS * max(row.unknowns for row in self.ranking):
            found.append(
                f"BIC counts {self.n_eff:.3g} effective points: too few to choose between laws; look at the errors."
            )
        errors = sorted((row.holdout_rms, row.law) for row in self.ranking if row.holdout_rms is not None)
        if errors and errors[0][0] > USELESS_HOLDOUT:
            found.append(f"No law predicts the sweeps held out: the smallest error is {errors[0][0]:.0%}.")
        elif errors and errors[0][1] != self.ranking[0].law:
            found.append(f"{errors[0][1]} predicts the sweeps held out best, {self.ranking[0].law} has the lowest BIC: "
                         "believe the hold-out.")  # fmt: skip
        return found

    def _repr_html_(self) -> str:
        return f"<pre>{self.summary()}</pre>"


def compare(measurements: Measurement | Sequence[Measurement], laws: Sequence[str], *, rng: np.random.Generator,
            holdout: Sequence[Measurement] = (), weights: Weights = "relative", screen: int = 300, starts: int = 3,
            report: Callable[[str, int, int, float], None] | None = None) -> Comparison:  # fmt: skip
    """Fit each of `laws` to the same sweeps and rank them by BIC on the effective number of points, and by hold-out.

    Parameters as in `fit`; each law gets a random stream of its own from `rng`, so that adding a law changes no other's
    fit. `report` gets the law, and then what it gets from `fit`.

    Raises
    ------
    ParameterError, UnknownNameError, OperationError
        As `fit`; or if `laws` is empty or names one twice.
    """
    sweeps, _ = check_inputs(measurements, holdout, screen, starts, rng)
    sizes(sweeps, weights)
    if isinstance(laws, str) or not isinstance(laws, Sequence) or not laws:
        raise ParameterError("compare.laws: expected the names of at least one law in a list, got none. Name some.")
    for law in laws:
        expect_type("compare.laws", law, str)
        check_count(choose(check_names(law, {}, ()), {}, ()), sweeps)
        if laws.count(law) > 1:
            raise ParameterError(f"compare.laws: expected each law once, got {law!r} twice. Remove one.")
    seed = int(rng.integers(2**63))
    streams = {law: np.random.default_rng(np.random.SeedSequence(seed, spawn_key=tuple(law.encode()))) for law in laws}
    fits: dict[str, Fit] = {}
    for law in laws:
        fits[law] = fit(measurements, law, rng=streams[law], holdout=holdout, weights=weights, screen=screen,
                        starts=starts, report=_named(report, law))  # fmt: skip
    return _rank(fits)


def _named(report: Callable[[str, int, int, float], None] | None, law: str) -> Any:
    return None if report is None else lambda done, total, best: report(law, done, total, best)


def _rank(fits: dict[str, Fit]) -> Comparison:
    best = min(fits.values(), key=lambda found: found.relative_rms)
    # One number of points for all laws: a worse law's residual is more correlated, and would be judged on fewer.
    points = max(best.n_eff, 2.0)
    bic = {}
    for law, found in fits.items():
        unknowns = len(found.fitted) + len(found.sweeps)
        bic[law] = points * math.log(max(found.relative_rms**2, 1e-300)) + unknowns * math.log(points)
    lowest = min(bic.values())
    ranking = tuple(
        Ranked(law=law, unknowns=len(fits[law].fitted) + len(fits[law].sweeps), relative_rms=fits[law].relative_rms,
               delta_bic=bic[law] - lowest, holdout_rms=fits[law].holdout_rms)
        for law in sorted(fits, key=lambda law: bic[law])
    )  # fmt: skip
    held = {law: found.holdout_rms for law, found in fits.items()}
    by_holdout = sorted((rms, law) for law, rms in held.items() if rms is not None)
    return Comparison(n_eff=points, ranking=ranking, by_holdout=tuple(law for _, law in by_holdout), fits=fits)
