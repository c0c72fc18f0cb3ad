"""What the files of an evolution run hold, field by field: damaged or altered ones are refused."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import ConfigDict, Field, model_validator

from ohmloom._files import StrictModel, advise, read_bytes, validate
from ohmloom.errors import FileFormatError, MissingFileError, shown
from ohmloom.neurocontroller import Adaptation, Network

REDO = "Delete it to redo this repeat."

Count = Annotated[int, Field(ge=0)]
Rate = Annotated[float, Field(gt=0.0, le=1.0)]
NotNegative = Annotated[float, Field(ge=0.0)]
Fraction = Annotated[float, Field(ge=0.0, le=1.0)]
TrialKey = Annotated[int, Field(ge=0, lt=2**64)]


class Rates(Adaptation):
    """The self-adaptive rates; evolution always has all of them."""

    mu: Rate
    psi: Rate
    omega: Rate
    tau: Rate


class IndividualEntry(StrictModel):
    """One network with its evaluations; `Network` itself checks the synapses."""

    hidden: str = Field(pattern=r"^[+-]+$")
    synapses: list[list[Any]]
    adaptation: Rates
    birth: Count
    trial_keys: list[TrialKey] = Field(min_length=1)
    total: NotNegative
    solved: Count
    trials: int = Field(ge=1)

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.solved > self.trials:
            raise ValueError(f"at most as many solved as trials, {self.trials}")
        if self.trials % len(self.trial_keys):
            raise ValueError(f"as many trials for each of {len(self.trial_keys)} trial_keys")
        return self


class Words(StrictModel):
    """State of PCG64."""

    state: int = Field(ge=0, lt=2**128)
    inc: int = Field(ge=0, lt=2**128)


class GeneratorEntry(StrictModel):
    """State of the generator of numpy's `default_rng`."""

    bit_generator: Literal["PCG64"]
    state: Words
    has_uint32: int = Field(ge=0, le=1)
    uinteger: int = Field(ge=0, lt=2**32)


class PopulationTable(StrictModel):
    """What `PopulationState.to_table` gives."""

    generation: Count
    births: Count
    trials: Count
    first_solved: Count | None
    first_reward_trial: Count | None
    first_solved_trial: Count | None
    generator: GeneratorEntry
    individuals: list[IndividualEntry]

    @model_validator(mode="after")
    def _check(self) -> Self:
        births = [individual.birth for individual in self.individuals]
        if births != sorted({*births}) or any(birth >= self.births for birth in births):
            raise ValueError(f"individuals in order of birth, each below births = {self.births}")
        if self.first_solved is not None and self.first_solved > self.generation:
            raise ValueError(f"first_solved of at most generation = {self.generation}")
        return self


class Row(StrictModel):
    """One observation of a population: a row of its table."""

    generation: Count
    best_fitness: NotNegative
    best_success: Fraction
    mean_fitness: NotNegative
    mean_success: Fraction
    connectivity: Fraction
    nodes: NotNegative
    hidden: NotNegative
    mu: Rate
    psi: Rate
    omega: Rate
    tau: Rate
    best_hp_input_hidden: Count
    best_peo_pani_input_hidden: Count
    best_linear_input_hidden: Count
    best_constant_input_hidden: Count
    best_hp_hidden_hidden: Count
    best_peo_pani_hidden_hidden: Count
    best_linear_hidden_hidden: Count
    best_constant_hidden_hidden: Count
    best_hp_hidden_output: Count
    best_peo_pani_hidden_output: Count
    best_linear_hidden_output: Count
    best_constant_hidden_output: Count


class CheckpointFile(StrictModel):
    """A whole checkpoint."""

    rows: list[Row]
    population: PopulationTable


def check_checkpoint(saved: Any, where: str, *, population: int, generations: int, starts: int) -> None:
    """Check the checkpoint of a repeat of these settings.

    Raises
    ------
    FileFormatError
        Names each field that breaks a rule.
    """
    checked = validate(CheckpointFile, saved, where)
    table, found = checked.population, len(checked.population.individuals)
    if found > population or (checked.rows and found != population):
        rule = f"{population} individuals" if checked.rows else f"at most {population} individuals"
        raise FileFormatError(f"{where}: population.individuals: expected {rule}, got {found}. Correct it.")
    seen = [row.generation for row in checked.rows]
    last = seen[-1] if seen else 0
    if table.generation > generations or last > table.generation or (not seen and table.generation):
        raise FileFormatError(f"{where}: population.generation: expected {last} to {generations if seen else 0}, "
                              f"got {table.generation}. Correct it.")  # fmt: skip
    if seen and (seen[0] != 0 or seen != sorted({*seen})):
        raise FileFormatError(f"{where}: rows: expected rising generations from 0, got others. Correct it.")
    for k, individual in enumerate(table.individuals):
        if individual.trials != starts * len(individual.trial_keys):
            raise FileFormatError(f"{where}: population.individuals[{k}].trials: expected {starts} for each of "
                                  f"{len(individual.trial_keys)} trial_keys, got {individual.trials}. "
                                  "Correct it.")  # fmt: skip


class Outcome(StrictModel):
    """What a finished network's provenance says of its repeat, among other things."""

    model_config = ConfigDict(extra="ignore")

    fitness: float
    solved: int = Field(ge=0)
    trials: int = Field(ge=1)
    first_solved: int | None
    first_reward_trial: int | None
    first_solved_trial: int | None


def read_outcome(path: Path) -> Outcome:
    """What the network of a finished repeat says of it."""
    try:
        return validate(Outcome, dict(Network.load(path).provenance), f"{path}: provenance")
    except FileFormatError as error:
        raise FileFormatError(*advise(error.problems, REDO)) from error


def last_row(path: Path, network: Path) -> dict[str, str]:
    """The last observation of a finished repeat's table."""
    redo = f"Delete {network} to redo this repeat."
    try:
        text = read_bytes(path, "table").decode()
    except MissingFileError as error:
        raise MissingFileError(*advise(error.problems, redo)) from error
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{path}: expected UTF-8 text, got other bytes. {redo}") from error
    lines = text.splitlines()
    names = list(Row.model_fields)
    if len(lines) < 2 or lines[0].split(",") != names or not text.endswith("\n"):
        raise FileFormatError(f"{path}: expected a table of {', '.join(names)}, got {shown(lines[:1])}. {redo}")
    last = dict(zip(names, lines[-1].split(","), strict=False))
    try:
        numbers: dict[str, Any] = {
            k: int(v) if Row.model_fields[k].annotation is int else float(v) for k, v in last.items()
        }
        Row(**numbers)
    except ValueError as error:
        raise FileFormatError(f"{path}: expected numbers in the last row, got {shown(lines[-1])}. {redo}") from error
    return last
