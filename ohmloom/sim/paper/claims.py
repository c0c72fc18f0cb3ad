"""Each claim of the paper with the test that stands for it, in its order: a line per claim."""

from __future__ import annotations

from typing import Final

from ohmloom.sim.paper.claim_tests import (
    KIND_NAMES,
    MEASURE_NAMES,
    Claim,
    Finding,
    all_events,
    early_events,
    kinds,
    kinds_differ,
    more_reliable,
    never,
    samples,
    signs_differ,
    solved,
    systems,
)
from ohmloom.sim.paper.results import Results


def examine(results: Results) -> list[Finding]:
    """Test every claim of `CLAIMS`, in the paper's order."""
    return [finding for claim in CLAIMS for finding in claim.examine(results)]


def examine_at_best(results: Results) -> list[Finding]:
    """Test the claims about the static task on the evolutions at the search's best combination; without any, none."""
    at_best = results.at_best
    if at_best is None:
        return []
    return [finding for claim in CLAIMS if claim.task == "static" for finding in claim.examine(at_best)]


# The paper's hypotheses and research questions, and the claims that it answers them with.
QUESTIONS: Final = {
    "Do memristive synapses improve performance? (hypothesis, Section I)": (
        "PEO-PANI networks find the goal sooner than constant ones",
        "linear networks find the goal sooner than constant ones",
        "PEO-PANI networks become fitter than constant ones",
    ),
    "Do mixtures give further advantages? (hypothesis; question 2)": (
        "mixed networks find the goal sooner than PEO ones",
        "mixed networks find the goal sooner than LIN ones",
        "mixed networks find the goal sooner than GA ones",
        "mixed networks become fitter than LIN ones",
        "mixed networks become fitter than GA ones",
        "mixed networks adapt to the moved reward sooner",
    ),
    "Can evolution outperform constant synapses despite the nonlinearity? (question 1)": (
        "PEO-PANI networks find the goal sooner than constant ones",
        "PEO-PANI networks become fitter than constant ones",
    ),
    "Does evolution give kinds of memristor their own roles? (question 3)": (
        "between hidden neurons linear synapses beat HP",
        "between hidden neurons linear synapses beat PEO-PANI",
        "to the outputs HP synapses beat PEO-PANI",
        "from excitatory neurons HP synapses beat PEO-PANI",
        "from excitatory neurons linear synapses beat PEO-PANI",
        "from infrared sensors PEO-PANI synapses beat HP",
        "to the outputs HP synapses beat linear ones",
        "to the outputs PEO-PANI synapses beat linear ones",
        "from light sensors HP synapses beat PEO-PANI",
    ),
}

CLAIMS: Final[tuple[Claim, ...]] = (
    solved("IX-A", "HP", (2, 30), "two of thirty HP runs never solve the task"),
    *(solved("IX-A", s, (0, 30), f"every {s} run solves the task") for s in ("PEO", "LIN", "GA")),
    systems("IX-A", "performance", "PEO", "GA", -1, "PEO-PANI networks find the goal sooner than constant ones"),
    systems("IX-A", "performance", "LIN", "GA", -1, "linear networks find the goal sooner than constant ones"),
    systems("IX-A", "performance", "HP", "PEO", 1, "HP networks find the goal later than PEO-PANI ones"),
    systems("IX-A", "performance", "HP", "LIN", 1, "HP networks find the goal later than linear ones"),
    systems("IX-A", "performance", "HP", "GA", 1, "HP networks find the goal later than constant ones"),
    systems("IX-A", "best_fitness", "PEO", "GA", 1, "PEO-PANI networks become fitter than constant ones"),
    systems("IX-A", "best_fitness", "PEO", "LIN", 1, "PEO-PANI networks become fitter than linear ones"),
    systems("IX-A", "best_fitness", "HP", "PEO", -1, "HP networks stay less fit than PEO-PANI ones"),
    *(
        systems("IX-B", measure, a, b, 0, f"{a} and {b} networks do not differ in {MEASURE_NAMES[measure]}")
        for measure in ("nodes", "connectivity")
        for a, b in (("HP", "PEO"), ("HP", "LIN"), ("HP", "GA"), ("PEO", "LIN"), ("PEO", "GA"), ("LIN", "GA"))
    ),
    *(
        systems("IX-C", "mu", system, "GA", 1, f"constant networks lower mu below that of {system} networks")
        for system in ("HP", "PEO", "LIN")
    ),
    systems("IX-C", "psi", "HP", "LIN", 1, "HP networks keep a higher psi than linear ones"),
    *(
        systems("X-B", "performance", "HET", other, -1, f"mixed networks find the goal sooner than {other} ones")
        for other in ("PEO", "LIN", "GA")
    ),
    *(
        systems("X-B", "best_fitness", "HET", other, 1, f"mixed networks become fitter than {other} ones")
        for other in ("LIN", "GA")
    ),
    systems("X-C", "connectivity", "HET", "LIN", -1, "mixed networks have fewer synapses than linear ones"),
    *(
        systems("X-C", "nodes", "HET", other, 0, f"mixed and {other} networks do not differ in neurons")
        for other in ("PEO", "LIN", "GA")
    ),
    systems("X-D", "mu", "HET", "GA", 1, "mixed networks keep a higher mu than constant ones"),
    *(
        systems("X-D", "psi", "HET", other, 1, f"mixed networks keep a higher psi than {other} ones")
        for other in ("LIN", "GA")
    ),
    kinds("XI-A", "hidden_hidden", "linear", "hp", "between hidden neurons linear synapses beat HP"),
    kinds("XI-A", "hidden_hidden", "linear", "peo_pani", "between hidden neurons linear synapses beat PEO-PANI"),
    kinds("XI-A", "hidden_output", "hp", "peo_pani", "to the outputs HP synapses beat PEO-PANI"),
    kinds("XI-B", "pre_excitatory", "hp", "peo_pani", "from excitatory neurons HP synapses beat PEO-PANI"),
    kinds("XI-B", "pre_excitatory", "linear", "peo_pani", "from excitatory neurons linear synapses beat PEO-PANI"),
    kinds("XI-B", "infrared", "peo_pani", "hp", "from infrared sensors PEO-PANI synapses beat HP"),
    samples(
        "XII-A",
        "PEO-PANI weights end higher than HP weights",
        "mean weight at the end of the trial",
        kinds_differ("peo_pani", "hp", "final_weight"),
    ),
    samples(
        "XII-A",
        "most STDP happens in the first 250 timesteps",
        "events per timestep before and after timestep 250",
        early_events,
    ),
    samples(
        "XII-A",
        "in these, HP synapses are weakened more often than strengthened",
        "HP events per timestep, negative less positive",
        signs_differ("hp", "negative", "positive"),
    ),
    samples(
        "XII-A",
        "in these, PEO-PANI synapses are strengthened more often than weakened",
        "PEO-PANI events per timestep, positive less negative",
        signs_differ("peo_pani", "positive", "negative"),
    ),
    samples(
        "XII-A",
        "in these, PEO-PANI synapses are strengthened more often than HP ones",
        "positive events per timestep, PEO-PANI less HP",
        kinds_differ("peo_pani", "hp", "set_up", "positive"),
    ),
    samples(
        "XII-A",
        "in these, HP synapses are weakened more often than PEO-PANI ones",
        "negative events per timestep, HP less PEO-PANI",
        kinds_differ("hp", "peo_pani", "set_up", "negative"),
    ),
    samples(
        "XII-A",
        "over whole trials synapses are strengthened more often than weakened",
        "events per timestep, positive less negative",
        all_events,
    ),
    never(
        "XII-B",
        "two named memristors of the best network start and end its turn",
        "that network was not published; the turn of ours stands in the tables",
    ),
    systems("XIII", "performance", "HET", "GA", -1, "mixed networks adapt to the moved reward sooner", "dynamic"),
    solved("XIII", "GA", (6, 30), "six of thirty constant runs never find both rewards", "dynamic"),
    solved("XIII", "HET", (0, 30), "every mixed run finds both rewards", "dynamic"),
    systems("XIII", "tau", "HET", "GA", -1, "mixed networks keep a lower tau", "dynamic"),
    *(
        kinds(
            "XIII-A",
            "hidden_output",
            kind,
            "linear",
            f"to the outputs {KIND_NAMES[kind]} synapses beat linear ones",
            "dynamic",
        )
        for kind in ("hp", "peo_pani")
    ),
    kinds("XIII-A", "light", "hp", "peo_pani", "from light sensors HP synapses beat PEO-PANI", "dynamic"),
    samples(
        "XIII-B",
        "PEO-PANI weights are higher than HP weights",
        "mean weight over the trial",
        kinds_differ("peo_pani", "hp", "mean_weight"),
        "dynamic",
    ),
    samples(
        "XIII-B",
        "HP synapses are weakened more often than strengthened",
        "HP events per timestep, negative less positive",
        signs_differ("hp", "negative", "positive", "whole_trial"),
        "dynamic",
    ),
    samples(
        "XIII-B",
        "PEO-PANI synapses are strengthened more often than weakened",
        "PEO-PANI events per timestep, positive less negative",
        signs_differ("peo_pani", "positive", "negative", "whole_trial"),
        "dynamic",
    ),
    never(
        "XIV",
        "such networks can be built with real memristors",
        "not by these experiments: `ohmloom evaluate` says for which hardware",
    ),
    Claim("static", more_reliable),
)
