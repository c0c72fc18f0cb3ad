"""Files of `ohmloom map`: complete, the same each time, and what the plan says."""

import csv

import numpy as np
import pytest

from ohmloom.circuits import Netlist, PulseTrain
from ohmloom.mapping import Hardware, Plan, Quantity, place
from ohmloom.neurocontroller import Network
from ohmloom.report.map_output import map_files, map_words, save_map, study_map

SMALL = Network.random(system="HP", rng=np.random.default_rng(2), hidden=3)
PEO = Network.random(system="PEO", rng=np.random.default_rng(2), hidden=3)
GA = Network.random(system="GA", rng=np.random.default_rng(2), hidden=3)
FAULTY = Quantity(value=0.02, source="definition")


def plan(name="hp_1t1r", network=None, **array):
    hardware = Hardware.load(name)
    changes = {"array": hardware.array.model_copy(update=array)}
    return place(network or SMALL, hardware.model_copy(update=changes))


def test_files_are_the_same_each_time_and_can_be_read_again(tmp_path):
    study = study_map(plan("hp_passive"))
    first = [path.read_bytes() for path in save_map(study, tmp_path / "a")]
    assert first == [path.read_bytes() for path in save_map(study_map(plan("hp_passive")), tmp_path / "b")]
    assert sorted(p.name for p in (tmp_path / "a").iterdir()) == sorted(map_files(study.plan))
    assert Plan.load(tmp_path / "a" / "plan.json").to_json() == study.plan.to_json()
    with (tmp_path / "a" / "placement.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["conductance_S"]) for row in rows] == [point.conductance for point in study.plan.crosspoints]
    assert Netlist.load(tmp_path / "a" / "tile_0.netlist.json").name == "tile_0_read"
    train = PulseTrain.read_csv(tmp_path / "a" / "tile_0_pulses.csv")
    assert train.v_row.shape[1] == len(study.plan.tiles[0].rows)


def test_words_say_what_a_reader_asks():
    text = "\n".join(map_words(study_map(plan(max_columns=3))))
    assert "tile 1, hp: " in text
    assert "synapses placed on 2 tiles" in text
    assert "% less" in text
    hard = "\n".join(map_words(study_map(plan("hp_strukov"))))
    assert "above the limit of 1.00%, which no size of tile would keep" in hard
    slow = "\n".join(map_words(study_map(plan("peo_pani", PEO))))
    assert "steps take longer than they have" in slow
    programmed = "\n".join(map_words(study_map(plan(network=GA))))
    assert "programming the constant synapses takes" in programmed
    assert "reset takes" not in programmed


def test_yield_is_shown_where_the_spec_has_faults():
    study = study_map(plan())
    assert study.yields == ()
    hardware = study.plan.hardware
    faults = hardware.nonidealities.model_copy(update={"stuck_off": FAULTY})
    faulty = place(study.plan.network, hardware.model_copy(update={"nonidealities": faults}))
    found = study_map(faulty, seed=3)
    assert found.yields[0].formula == pytest.approx(0.98 ** len(faulty.crosspoints))
    assert found.yields == study_map(faulty, seed=3).yields
    assert f"yield {found.yields[0].formula:.1%} by formula" in "\n".join(map_words(found))
    assert found.to_dict()["tiles"][0]["yield"]["dies"] == 200


def test_skewed_clocks_have_no_schedule(tmp_path):
    study = study_map(plan(delays="retimed"))
    save_map(study, tmp_path)
    assert not list(tmp_path.glob("pulses*"))
    assert study.to_dict()["late_steps"] is None


def test_a_net_without_synapses_has_files_too(tmp_path):
    none = Network.random(system="HP", rng=np.random.default_rng(0)).replace(synapses=())
    paths = save_map(study_map(plan(network=none)), tmp_path)
    assert {path.name for path in paths} == {"plan.json", "placement.csv", "reset.csv", "cost.csv", "crossbars.png",
                                             "pulses.csv"}  # fmt: skip
