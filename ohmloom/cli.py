"""The command line: parse, call one public function, print.

Results go to stdout (``--json`` for machines), progress and errors to stderr, files only where ``--out`` says. Exit
codes: 0 done, 1 the check said no, 2 bad input or usage, 3 operational failure, 130 interrupted.
"""

from __future__ import annotations

import json
import os
import shlex
import sys
from pathlib import Path
from typing import Annotated, Any, Literal, NoReturn

import typer

from ohmloom import __version__
from ohmloom._cli_check import check_network
from ohmloom._cli_circuit import app as circuit_app
from ohmloom._cli_device import app as device_app
from ohmloom._cli_evaluate import evaluate_networks
from ohmloom._cli_fmu import app as fmu_app
from ohmloom._cli_fmu import join_start_values
from ohmloom._cli_map import HardwareHelp, map_network
from ohmloom._cli_paper import run_paper
from ohmloom._cli_work import show_status, watch_run, work_on_run
from ohmloom._terminal import bars, check_folder, check_targets, say
from ohmloom.errors import Interrupted, OhmloomError, OperationError, ParameterError

app = typer.Typer(
    name="ohmloom", no_args_is_help=True, add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False,
    help="Can this evolved spiking controller be built out of real memristors, and will it still do its job?",
)  # fmt: skip
app.add_typer(device_app, name="device")
app.add_typer(circuit_app, name="circuit")
app.add_typer(fmu_app, name="fmu")

INTERRUPTED = 130
System = Literal["HP", "PEO", "LIN", "GA", "HET"]
Task = Literal["static", "dynamic"]
NetArgument = Annotated[Path, typer.Argument(metavar="NET", help="Network file (*.net.json).")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")]
SeedOption = Annotated[int, typer.Option("--seed", min=0, help="Every random number follows from it.")]


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and exit; errors are one line on stderr, without a traceback."""
    if sys.stdout is None or sys.stderr is None:
        sys.exit(3)
    words = list(sys.argv[1:] if arguments is None else arguments)
    verbose = "--verbose" in words
    words = [word for word in words if word != "--verbose"]
    if words[:1] == ["fmu"]:
        words = join_start_values(words)
    try:
        code = app(words, standalone_mode=False)
        sys.stdout.flush()
        if code == INTERRUPTED:
            _interrupted("interrupted.", words)
        sys.exit(code if isinstance(code, int) else 0)
    except (typer.Abort, KeyboardInterrupt):
        _interrupted("interrupted.", words)
    except Interrupted as error:
        _interrupted(str(error), words)
    except OhmloomError as error:
        more = len(error.problems) - 1
        text = str(error) if verbose else error.problems[0] + (f" (and {more} more; see --verbose)" if more else "")
        _fail(text, 3 if isinstance(error, OperationError) else 2)
    except typer.TyperException as error:
        message = error.format_message().replace("Value error, ", "").strip()
        if message.startswith("Usage:"):
            print(message)
            sys.exit(2)
        _fail(f"{message.rstrip('.')}. See 'ohmloom --help'.", 2)
    except BrokenPipeError:
        # The reader of our output is gone; nothing is left to tell it.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(3)
    except OSError as error:
        _fail(f"{error.filename or 'system'}: expected to read and write files, got {error.strerror or error}.", 3)


def _interrupted(text: str, words: list[str]) -> NoReturn:
    # A study that was to be shown only has nothing to resume from.
    can = words[:1] in (["evolve"], ["work"]) or (
        words[:1] == ["evaluate"] and any(w.startswith("--out") for w in words)
    )
    resume = f" Resume with: ohmloom {shlex.join(words)}" if can else ""
    _fail(text + resume, INTERRUPTED)


def _fail(text: str, code: int) -> NoReturn:
    print(f"ohmloom: {text}", file=sys.stderr)
    sys.exit(code)


def _show_version(wanted: bool) -> None:
    if wanted:
        print(__version__)
        raise typer.Exit


@app.callback()
def _options(
    # Neither is used here: the callback prints the version, and `main` takes --verbose out before parsing.
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version and exit.")
    ] = False,
    verbose: Annotated[
        bool, typer.Option("--verbose", help="On bad input, print every problem that was found.")
    ] = False,
) -> None:
    pass


@app.command()
def evolve(
    system: Annotated[System, typer.Option(help="Kinds of synapse: HP, PEO, LIN, GA (constant) or HET (mixed).")],
    out: Annotated[Path, typer.Option(help="Run folder; the same command resumes it.")],
    repeats: Annotated[int, typer.Option(min=1, help="Independent repeats.")] = 1,
    generations: Annotated[int, typer.Option(min=0, help="Generations after the first.")] = 1000,
    population: Annotated[int, typer.Option(min=3, help="Networks per population.")] = 100,
    seed: SeedOption = 0,
    workers: Annotated[int, typer.Option(min=1, help="Processes; they do not change the result.")] = 1,
    task: Annotated[Task, typer.Option(help="One goal, or a goal that moves.")] = "static",
    starts: Annotated[int, typer.Option(min=1, help="Fitness is the mean over this many starts (1: the paper's).")] = 1,
    reevaluate: Annotated[bool, typer.Option("--reevaluate", help="Try a parent again whenever it is used.")] = False,
    settings: Annotated[
        Path | None, typer.Option(help="TOML file with settings of controller and arena that the paper leaves open.")
    ] = None,
    json_: JsonOption = False,
) -> None:
    """Evolve spiking networks with plastic memristive synapses."""
    from ohmloom.sim import EvolutionSettings, OpenSettings
    from ohmloom.sim import evolve as run

    left_open = {} if settings is None else dict(OpenSettings.load(settings))
    chosen = EvolutionSettings(
        system=system, repeats=repeats, generations=generations, population=population, seed=seed, task=task,
        starts=starts, reevaluate=reevaluate, **left_open,
    )  # fmt: skip
    say(f"{system}, {repeats} repeats of {generations} generations, seed {seed} (compiling at the first run)")
    with bars({k: f"{system} {k}" for k in range(repeats)}, generations) as update:
        evolution = run(
            chosen, out=out, workers=workers,
            report=lambda k, row: update(k, int(row["generation"]), f"best {row['best_fitness']:.0f}, "
                                         f"success {row['best_success']:.0%}, mean {row['mean_fitness']:.0f}"),
        )  # fmt: skip
    if json_:
        _print_json({"out": str(out), "settings": chosen.model_dump(), "repeats": [
            {"repeat": r.repeat, "best_fitness": r.best_fitness, "best_success": r.best_success,
             "mean_fitness": r.mean_fitness, "first_solved": r.first_solved, "network": str(r.network)}
            for r in evolution.repeats
        ]})  # fmt: skip
        return
    for r in evolution.repeats:
        first = "never" if r.first_solved is None else f"in generation {r.first_solved}"
        print(f"{r.network}: fitness {r.best_fitness:.1f}, goal from {r.best_success:.0%} of its starts, "
              f"first reached {first}")  # fmt: skip


app.command("map")(map_network)
app.command("check")(check_network)
app.command("evaluate")(evaluate_networks)
app.command("paper")(run_paper)
app.command("work")(work_on_run)
app.command("status")(show_status)
app.command("watch")(watch_run)


@app.command()
def replay(
    net: NetArgument,
    out: Annotated[Path, typer.Option(help="FILE.html, FILE.gif or FILE.png.")],
    hardware: Annotated[str | None, typer.Option(help=HardwareHelp + " Without it: the ideal controller.")] = None,
    seed: SeedOption = 0,
    die: Annotated[
        int | None, typer.Option(min=0, help="Die and start of this number in 'evaluate' with the same seed.")
    ] = None,
    task: Annotated[Task | None, typer.Option(help="Default: the network's own.")] = None,
) -> None:
    """Show one trial: robot, sensors, spikes and weights, as a page, an animation or a figure."""
    from ohmloom.mapping import Hardware
    from ohmloom.neurocontroller import Network
    from ohmloom.report.output import check_suffix, replay_network

    check_suffix(out)
    if out.is_dir():
        raise ParameterError(f"--out: expected a file, got the folder {out}. Use another path.")
    check_folder(out.parent)
    check_targets([out], [net, *([Path(hardware)] if hardware else [])])
    network = Network.load(net)
    spec = None if hardware is None else Hardware.load(hardware)
    trial = replay_network(network, out, hardware=spec, seed=seed, task=task, die=die)
    end = "goal reached" if trial.solved else "goal not reached"
    print(f"{out}: {end} in {trial.timesteps} counted timesteps ({len(trial.actions)} executed), "
          f"{trial.bumps} bumps, seed {seed}")  # fmt: skip


@app.command()
def demo(
    out: Annotated[Path, typer.Option(help="Folder for what it makes.")] = Path("ohmloom-demo"),
) -> None:
    """Every piece once, on shipped inputs, computed now: under a minute, and one more when it compiles."""
    from ohmloom.report.demo import run_demo

    check_folder(out)
    run_demo(out, say=print)


@app.command()
def doctor(json_: JsonOption = False) -> None:
    """Say what works here: versions, compiled kernels, tools."""
    from ohmloom.report.doctor import examine

    findings = examine()
    works = all(finding.works for finding in findings if finding.is_core)
    if json_:
        _print_json({"works": works, "findings": [vars(finding) for finding in findings]})
    else:
        for finding in findings:
            mark = "ok" if finding.works else ("FAIL" if finding.is_core else "absent")
            print(f"{mark:7}{finding.name:18}{finding.detail}")
        print("the core works" if works else "the core does not work")
    raise typer.Exit(0 if works else 1)


def _print_json(table: Any) -> None:
    print(json.dumps(table, indent=1))
