"""`ohmloom device fit` and `ohmloom device compare`."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ohmloom import _measurement_options as options
from ohmloom._terminal import bars, check_folder, check_targets, say
from ohmloom.errors import ParameterError, UnknownNameError
from ohmloom.units import format_quantity, parse_quantity

if TYPE_CHECKING:
    from ohmloom.devices import Fit, Measurement

# Laws that are meant for measured loops, or that these are commonly compared with.
COMPARED = ("hp_linear", "hp_biolek", "tio2_threshold", "mirror_threshold", "peo_pani_mirror", "peo_pani_redox")
PATIENCE = 2.0  # s before a fit shows how far it is
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")]
SeedOption = Annotated[int, typer.Option("--seed", min=0, help="Every random number follows from it.")]


def device_fit(
    files: options.Files,
    law: Annotated[str, typer.Option(metavar="LAW", help="Law to fit; 'ohmloom device list --laws' has them all.")],
    holdout: options.Holdout = None,
    time: options.Time = "t",
    no_time: options.NoTime = False,
    voltage: options.Voltage = "v",
    current: options.Current = "i",
    unit: options.Units = None,
    frequency: options.Frequencies = None,
    sample_interval: options.Interval = None,
    series_resistance: options.Resistances = None,
    rows: options.Rows = None,
    every: options.Every = 1,
    invert_current: options.Inverted = False,
    fix: Annotated[
        list[str] | None, typer.Option(metavar="NAME=VALUE", help="Hold a parameter, as r_on=5k. May be repeated.")
    ] = None,
    free: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Fit a parameter that is held by default. May be repeated.")
    ] = None,
    weights: options.Weights = "relative",
    screen: options.Screen = 300,
    starts: options.Starts = 3,
    profile: Annotated[
        bool, typer.Option("--profile", help="Find every interval by profile likelihood; takes longer.")
    ] = False,
    name: Annotated[str | None, typer.Option(metavar="NAME", help="Name of the card. Default: law and sweep.")] = None,
    seed: SeedOption = 0,
    out: Annotated[
        Path | None, typer.Option(help="Folder for device.toml (the card), fit.json, fit.png, fit.pdf, profiles.png.")
    ] = None,
    json_: JsonOption = False,
) -> None:
    """Fit a law to measured sweeps: parameters with 95 % intervals, warnings, pictures and a device card.

    Several sweeps are fitted together: they share the parameters, and each has a start state of its own.
    """
    import numpy as np

    from ohmloom.devices import fit
    from ohmloom.report.fit_output import FIT_FILES, save_fit

    reading = options.Reading(
        time=time, no_time=no_time, voltage=voltage, current=current, units=unit or (), frequencies=frequency or (),
        interval=sample_interval, resistances=series_resistance or (), rows=rows, every=every, inverted=invert_current,
    )  # fmt: skip
    fixed, weighted = _fixed(law, fix or ()), options.parse_weights(weights)
    sweeps, held_out = _read(reading, files, holdout or ())
    _check_out(out, FIT_FILES, [*files, *(holdout or ())])
    text = f"fitting {law} to {_count(sweeps)}, {screen} random starts, seed {seed}"
    with _progress([law], () if json_ else (*sweeps, *held_out), text) as report, options.named_as_options():
        found = fit(
            sweeps, law, rng=np.random.default_rng(seed), holdout=held_out, fixed=fixed, free=free or (),
            weights=weighted, screen=screen, starts=starts, profile=profile, name=name,
            report=lambda done, total, best: report(law, done, total, best),
        )  # fmt: skip
    if not json_:
        # Before anything is written: a full disk must not cost the result.
        print(found.summary())
        for text in found.warnings:
            print(f"warning: {text}", flush=True)
    paths = [] if out is None else save_fit(found, out)
    if json_:
        _print_json({**_fit_table(found), "seed": seed, "files": [str(path) for path in paths]})
        return
    for path in paths:
        print(path)


def device_compare(
    files: options.Files,
    laws: Annotated[
        str, typer.Option(metavar="A,B,...", help="Laws to compare; 'ohmloom device list --laws' has them all.")
    ] = ",".join(COMPARED),
    holdout: options.Holdout = None,
    time: options.Time = "t",
    no_time: options.NoTime = False,
    voltage: options.Voltage = "v",
    current: options.Current = "i",
    unit: options.Units = None,
    frequency: options.Frequencies = None,
    sample_interval: options.Interval = None,
    series_resistance: options.Resistances = None,
    rows: options.Rows = None,
    every: options.Every = 1,
    invert_current: options.Inverted = False,
    weights: options.Weights = "relative",
    screen: options.Screen = 300,
    starts: options.Starts = 3,
    reference: Annotated[
        Path | None, typer.Option(metavar="FILE", help="FMU with v in and i out, as it is, beside the laws.")
    ] = None,
    seed: SeedOption = 0,
    out: Annotated[
        Path | None, typer.Option(help="Folder for LAW.toml (each law's card), comparison.json, .png and .pdf.")
    ] = None,
    json_: JsonOption = False,
) -> None:
    """Fit several laws to the same sweeps and rank them: by BIC, and by their error on sweeps held out."""
    import numpy as np

    from ohmloom.devices import compare
    from ohmloom.report.fit_output import comparison_files, save_comparison

    reading = options.Reading(
        time=time, no_time=no_time, voltage=voltage, current=current, units=unit or (), frequencies=frequency or (),
        interval=sample_interval, resistances=series_resistance or (), rows=rows, every=every, inverted=invert_current,
    )  # fmt: skip
    chosen = [law.strip() for law in laws.split(",") if law.strip()]
    weighted = options.parse_weights(weights)
    for law in chosen:
        _check_law("--laws", law)
    sweeps, held_out = _read(reading, files, holdout or ())
    _check_out(out, comparison_files(chosen), [*files, *(holdout or ())])
    errors = {} if reference is None else _reference(reference, (*sweeps, *held_out))
    text = f"fitting {len(chosen)} laws to {_count(sweeps)}, {screen} random starts each, seed {seed}"
    with _progress(chosen, () if json_ else (*sweeps, *held_out), text) as report, options.named_as_options():
        found = compare(
            sweeps, chosen, rng=np.random.default_rng(seed), holdout=held_out, weights=weighted, screen=screen,
            starts=starts, report=report,
        )  # fmt: skip
    paths = [] if out is None else save_comparison(found, out)
    if json_:
        _print_json({
            "ranking": [row.model_dump() for row in found.ranking], "by_holdout": list(found.by_holdout),
            "fits": {law: _fit_table(one) for law, one in found.fits.items()}, "seed": seed,
            "files": [str(path) for path in paths],
            **({} if reference is None else {"reference": {"file": str(reference), "relative_rms": errors}}),
        })  # fmt: skip
        return
    print(found.summary())
    for name, error in errors.items():
        print(f"{reference} beside {name}: relative RMS {100.0 * error:.3g} %")
    for path in paths:
        print(path)


def _reference(file: Path, sweeps: Sequence[Measurement]) -> dict[str, float]:
    """Relative RMS of an FMU's current by sweep."""
    from ohmloom.fmu import Host, reference_errors

    with Host(file) as host:
        return dict(reference_errors(host, sweeps))


def _check_law(option: str, law: str) -> None:
    from ohmloom.devices import LAWS

    if law not in LAWS:
        raise UnknownNameError.of(option, law, LAWS)


def _fixed(law: str, texts: Sequence[str]) -> dict[str, float]:
    """Values to hold in SI, each with or without the parameter's unit."""
    from ohmloom.devices import LAWS

    _check_law("--law", law)
    units = {parameter.name: parameter.unit for parameter in LAWS[law].parameters}
    fixed = {}
    for name, text in options.pairs("--fix", "NAME=VALUE", texts).items():
        if name not in units:
            raise UnknownNameError.of("--fix", name, units)
        fixed[name] = parse_quantity(text, units[name], where=f"--fix {name}")
    return fixed


def _read(
    reading: options.Reading, files: Sequence[Path], holdout: Sequence[Path]
) -> tuple[tuple[Measurement, ...], tuple[Measurement, ...]]:
    everything = reading.read([*files, *holdout])
    return everything[: len(files)], everything[len(files) :]


def _check_out(out: Path | None, names: Sequence[str], inputs: list[Path]) -> None:
    if out is None:
        return
    check_folder(out)
    targets = [out / name for name in names]
    check_targets(targets, inputs)
    for target in targets:
        if target.is_dir():
            raise ParameterError(f"--out: expected a place for the file {target.name}, got a folder of that name in "
                                 f"{out}. Use another path.")  # fmt: skip


@contextmanager
def _progress(laws: list[str], sweeps: Sequence[Measurement], text: str) -> Iterator[Any]:
    """A function for `compare` to report to: what the data of `sweeps` say before any law is fitted, then bars.

    Both begin with the first report, which comes once all is checked, so that an error stands alone.
    """
    with ExitStack() as stack:
        update: list[Any] = []

        def report(law: str, done: int, total: int, best: float) -> None:
            if not update:
                for sweep in sweeps:
                    _introduce(sweep)
                say(text)
                update.append(stack.enter_context(bars(dict(enumerate(laws)), 1, patience=PATIENCE)))
            if done:
                update[0](laws.index(law), done, f"best relative RMS {best:.4f}", total)

        yield report


def _introduce(sweep: Measurement) -> None:
    from ohmloom.devices import charge_revisit

    offset = sweep.zero_offset()
    pinched = "never at v = 0" if offset is None else f"at v = 0 the current is {offset:+.2%} of the largest"
    print(f"{sweep.name}: {len(sweep.t)} points in {format_quantity(sweep.duration, 's')}, {pinched}")
    print(f"  {charge_revisit(sweep).verdict}", flush=True)


def _count(sweeps: Sequence[Measurement]) -> str:
    points = sum(len(sweep.t) for sweep in sweeps)
    return f"{len(sweeps)} sweep{'s' if len(sweeps) > 1 else ''}, {points} points"


def _fit_table(fit: Fit) -> dict[str, Any]:
    from ohmloom.devices import LAWS

    units = {parameter.name: parameter.unit for parameter in LAWS[fit.law].parameters}
    return {
        "name": fit.device.name, "law": fit.law, "relative_rms": fit.relative_rms, "holdout_rms": fit.holdout_rms,
        "parameters": {key: {"value": value, "unit": units[key], "interval": fit.intervals[key],
                             "is_at_bound": key in fit.at_bound} for key, value in fit.parameters.items()},
        "held": {key: {"value": value, "unit": units[key]} for key, value in fit.held.items()},
        "sweeps": [_sweep_table(sweep) for sweep in fit.sweeps],
        "holdout": [_sweep_table(sweep) for sweep in fit.holdout],
        "n_eff": fit.n_eff, "aic": fit.aic, "bic": fit.bic, "condition": fit.condition, "weakest": fit.weakest,
        "starts": [start.model_dump(exclude={"parameters"}) for start in fit.starts],
        "warnings": list(fit.warnings),
    }  # fmt: skip


def _sweep_table(sweep: Any) -> dict[str, Any]:
    table: dict[str, Any] = sweep.model_dump(exclude={"t", "v", "i", "i_fit", "s"})
    return {**table, "points": len(sweep.t)}


def _print_json(table: Any) -> None:
    print(json.dumps(table, indent=1))
