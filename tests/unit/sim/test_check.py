"""Discrete against continuous: the exact box is green where it must be, and turns red when anything is wrong."""

import json

import numpy as np
import pytest

from ohmloom.cli import main
from ohmloom.errors import FileFormatError
from ohmloom.mapping import Hardware, place
from ohmloom.neurocontroller import Network
from ohmloom.neurocontroller.plain import stdp_sign
from ohmloom.sim import Arena, Check, check
from ohmloom.sim.exact_case import Case, exact_variant
from ohmloom.sim.exactness import EXACT, exact_box

ARENA = Arena(task="static", max_timesteps=25)
NAMES = {
    "rule_table", "pair_histories", "current_pulse", "voltage_pulse", "exact_width_pulse", "network_charge",
    "network_flux", "lattice", "wire_limit", "ladder", "column_serial_delay", "kirchhoff",
}  # fmt: skip


def case(network, spec, **options):
    return Case(plan=place(network, Hardware.load(spec)), trial_key=5, arena=ARENA, **options)


def random(system, seed=4):
    return Network.random(system=system, rng=np.random.default_rng(seed))


@pytest.mark.parametrize(
    ("system", "spec"),
    [
        ("HP", "ideal"), ("PEO", "ideal"), ("LIN", "ideal"), ("HET", "ideal"), ("HP", "hp_1t1r"), ("PEO", "peo_pani"),
        ("HET", "het_mixed"), ("LIN", "het_mixed"),
    ],
)  # fmt: skip
def test_all_twelve_hold(system, spec):
    holds, skipped = exact_box(case(random(system), spec))
    assert set(holds) == NAMES == set(EXACT)
    assert all(holds.values())
    assert skipped == {}


@pytest.mark.parametrize("system", ["HP", "PEO", "LIN", "HET"])
def test_devices_that_follow_their_equations_are_exact_too(system):
    one = case(random(system, 7), "ideal", integrate=True)
    assert one.charge.exact
    assert one.flux.exact
    assert one.charge.worst_weight_error < 1e-9
    # Integration rounds, and the closed forms do not: these are not the same numbers twice.
    assert one.charge.worst_weight_error > 0.0


def test_closed_forms_are_equal_to_the_last_bit():
    one = case(random("HET"), "het_mixed")
    assert one.charge.worst_weight_error == 0.0
    # The inverse of a flux is an iteration, whose last bits depend on how it was compiled.
    assert one.flux.worst_weight_error < 1e-12
    assert one.charge.ties == one.flux.ties == 0


def test_a_ratio_of_160_claims_no_lattice():
    holds, skipped = exact_box(case(random("HP"), "hp_strukov"))
    assert set(holds) == NAMES - {"lattice"}
    assert all(holds.values())
    assert skipped["lattice"].startswith("the cards of hp have not the paper's law and ratio 100")


def test_redox_devices_claim_no_exactness():
    holds, skipped = exact_box(case(random("PEO"), "peo_pani_redox"))
    assert set(skipped) == {
        "current_pulse", "voltage_pulse", "exact_width_pulse", "network_charge", "network_flux", "lattice"
    }  # fmt: skip
    assert skipped["network_charge"] == (
        "peo_pani (peo_pani_redox): the state is not moved by the current alone, so no exactness is claimed"
    )
    assert all(holds.values())


def test_constant_synapses_have_no_events_to_check():
    holds, skipped = exact_box(case(random("GA"), "hp_1t1r"))
    assert skipped["rule_table"] == "no plastic synapse"
    assert {"wire_limit", "ladder", "kirchhoff", "column_serial_delay"} <= set(holds)
    assert all(holds.values())


def test_a_rule_in_which_ties_fire_turns_the_box_red():
    def wrong(pre, post, threshold):
        return 1 if pre == post and pre + post > threshold else stdp_sign(pre, post, threshold)

    holds, _ = exact_box(case(random("HP"), "ideal", rule=wrong))
    assert not holds["rule_table"]
    assert not holds["pair_histories"]
    assert holds["current_pulse"]


@pytest.mark.parametrize("perturb", [1e-4, -1e-3])
def test_a_wrong_charge_turns_the_box_red(perturb):
    holds, _ = exact_box(case(random("HET"), "ideal", perturb=perturb))
    broken = {name for name, ok in holds.items() if not ok}
    assert broken == {"current_pulse", "voltage_pulse", "exact_width_pulse", "network_charge", "network_flux"}


def test_a_tap_that_is_wrong_by_a_step_turns_the_box_red(monkeypatch):
    from ohmloom.mapping import _kernels

    right = _kernels.read_column.py_func if hasattr(_kernels.read_column, "py_func") else _kernels.read_column
    monkeypatch.setattr(_kernels, "read_column", lambda a, b, c, d, j, now: right(a, b, c, d, j, now - 1))
    assert EXACT["column_serial_delay"](case(random("HP"), "ideal")) is False


@pytest.fixture(scope="module")
def checked():
    return check(random("HP"), Hardware.load("ideal"), seed=3, arena=ARENA)


def test_divergence_is_measured_by_scheme_and_kind(checked):
    assert checked.passes
    assert set(checked.divergence) == {"as_specified", "charge_metered", "voltage", "exact_width"}
    assert checked.divergence["charge_metered"]["hp"] < 1e-9
    assert checked.divergence["voltage"]["hp"] > 1e-3
    voltage = checked.schemes["voltage"]
    assert 0.0 < voltage.at_bounds["hp"] < 1.0
    assert voltage.events > 0
    assert voltage.first_divergence is not None
    assert set(voltage.closed_loop) == {"ideal", "hardware", "action_agreement"}


def test_divergence_never_fails_a_check(checked):
    assert checked.schemes["voltage"].spike_agreement < 1.0
    assert checked.passes


def test_a_check_comes_back_from_its_file(checked, tmp_path):
    checked.save(tmp_path / "check.json")
    again = Check.load(tmp_path / "check.json")
    assert again.to_dict() == checked.to_dict()
    (tmp_path / "other.json").write_text('{"format": "ohmloom.check", "version": 1}')
    with pytest.raises(FileFormatError, match=r"other\.json: expected a check saved by ohmloom"):
        Check.load(tmp_path / "other.json")


def test_the_picture_shows_box_and_divergence(checked):
    from ohmloom.report.check_plot import plot_check

    figure = plot_check(checked)
    box, panel = figure.axes
    assert box.get_title(loc="left") == "Exact: the simulator is right"
    assert len(panel.lines) == 4


def test_the_variant_keeps_cards_and_waveform_and_nothing_that_disturbs():
    variant = exact_variant(Hardware.load("hp_strukov"), "charge_metered")
    assert variant.cards == Hardware.load("hp_strukov").cards
    assert variant.wires.is_ideal
    assert (variant.array.access, variant.array.disabled, variant.drive.parallelism) == ("1T1R", "masked", "column")


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """`ohmloom check` of a random network, on trials of 25 timesteps."""
    monkeypatch.setattr(Arena, "paper", classmethod(lambda cls, task="static": ARENA))
    random("HP").save(tmp_path / "small.net.json")

    def call(*words):
        with pytest.raises(SystemExit) as done:
            main(["check", str(tmp_path / "small.net.json"), *words])
        captured = capsys.readouterr()
        return done.value.code, captured.out, captured.err

    return call


def test_the_verb_says_what_holds_and_what_the_drive_does(run, tmp_path):
    code, out, _ = run("--hardware", "ideal", "--out", str(tmp_path / "out"))
    assert code == 0
    assert " on ideal: exact" in out
    assert "network_flux        holds" in out
    assert "worst rms of W: hp" in out
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"check.json", "divergence.png"}


def test_the_verb_fails_on_a_wrong_charge(run):
    code, out, _ = run("--hardware", "ideal", "--perturb", "0.001", "--json")
    assert code == 1
    table = json.loads(out)
    assert table["exact"]["network_charge"] is False
    assert table["exact"]["rule_table"] is True
    assert set(table["divergence"]) == {"as_specified", "charge_metered", "voltage", "exact_width"}


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--hardware", "het_mixd"], "Did you mean 'het_mixed'?"),
        (["--hardware", "peo_pani"], "cards.hp: expected a device card, got none"),
        (["--hardware", "ideal", "--perturb", "-2"], "check.perturb: expected a number > -1"),
    ],
)
def test_bad_input_is_one_line_and_exit_2(run, words, text):
    code, _, err = run(*words)
    assert code == 2
    assert text in err.strip().splitlines()[-1]
    assert "Traceback" not in err


@pytest.mark.parametrize("seed", [1007, 1013])
def test_kirchhoffs_law_holds_where_the_currents_of_the_lines_all_but_cancel(seed):
    # Driven with both signs, little net current is left in the lines of these networks.
    assert EXACT["kirchhoff"](case(random("HP", seed), "ideal")) is True
