"""Network files: what is written comes back, and every broken rule is named with file, field and value."""

from __future__ import annotations

import copy
import json

import numpy as np
import pytest

from ohmloom.errors import (
    FileFormatError,
    MissingFileError,
    OhmloomError,
    OperationError,
    ParameterError,
    UnknownNameError,
)  # fmt: skip
from ohmloom.neurocontroller import Adaptation, Network, Readings, SpikingController, Synapse, mutate

# Neurons: inputs 0..5, hidden 6..8, outputs 9 and 10.
GOOD = {
    "format": "ohmloom.network",
    "version": 1,
    "system": "HET",
    "readings": {"lateral": "descending", "synapse_gain": 0.25},
    "inputs": 6,
    "hidden": ["excitatory", "inhibitory", "excitatory"],
    "outputs": 2,
    "synapses": [
        {"pre": 0, "post": 6, "kind": "hp", "weight": 0.5},
        {"pre": 8, "post": 6, "kind": "peo_pani", "weight": 0.5},
        {"pre": 7, "post": 10, "kind": "linear", "weight": 0.5},
    ],
    "adaptation": {"mu": 0.1, "psi": 0.2, "omega": 0.5, "tau": 0.1},
    "provenance": {"seed": 1, "generation": 40, "fitness": 11718.0, "task": "static",
                   "trial_key": 81985529216486895, "ohmloom": "0.1.0"},
}  # fmt: skip


def write(tmp_path, table, name="net.net.json"):
    path = tmp_path / name
    path.write_text(table if isinstance(table, str) else json.dumps(table))
    return path


def changed(field, value):
    """GOOD with the field at a path like ``synapses[0].weight`` set to `value`."""
    table = copy.deepcopy(GOOD)
    place = table
    *parents, last = [int(p) if p.isdigit() else p for p in field.replace("[", ".").replace("]", "").split(".")]
    for parent in parents:
        place = place[parent]
    place[last] = value
    return table


def refusal(tmp_path, table):
    path = write(tmp_path, table)
    with pytest.raises(FileFormatError) as caught:
        Network.load(path)
    assert isinstance(caught.value, OhmloomError)
    for problem in caught.value.problems:
        assert problem.startswith(f"{path}: ")
    return str(caught.value).replace(str(path), "FILE")


def test_loading_what_the_format_describes(tmp_path):
    network = Network.load(write(tmp_path, GOOD))
    assert network.system == "HET"
    assert network.hidden == ("excitatory", "inhibitory", "excitatory")
    assert network.neurons == 11
    assert network.synapses[1] == Synapse(8, 6, "peo_pani", 0.5)
    assert [network.delay(s) for s in network.synapses] == [1, 2, 1]
    assert [network.sign(j) for j in (0, 6, 7, 8, 9)] == [1.0, 1.0, -1.0, 1.0, 1.0]
    assert network.readings == Readings()
    assert network.adaptation == Adaptation(mu=0.1, psi=0.2, omega=0.5, tau=0.1)
    assert network.provenance == GOOD["provenance"]
    assert network.connectivity == 3 / 27  # 6 * 3 input, 3 lateral and 3 * 2 output pairs are legal


@pytest.mark.parametrize("system", ["HP", "PEO", "LIN", "GA", "HET"])
def test_round_trip(tmp_path, system):
    readings = Readings(lateral="both", synapse_gain=0.75, carry_state=False, weight_at="emission")
    network = Network.random(system=system, rng=np.random.default_rng(5), readings=readings)
    network = network.replace(name="a net", provenance={"ohmloom": "0.1.0", "seed": 3, "note": 'with "quotes" and µ'})
    path = tmp_path / "deep" / "net.net.json"
    network.save(path)
    assert Network.load(path) == network
    again = tmp_path / "again.net.json"
    Network.load(path).save(again)
    assert again.read_bytes() == path.read_bytes()


def test_what_is_saved_has_every_reading(tmp_path):
    Network.load(write(tmp_path, GOOD)).save(tmp_path / "out.net.json")
    saved = json.loads((tmp_path / "out.net.json").read_text())
    assert set(saved["readings"]) == {
        "lateral", "synapse_gain", "a", "b", "c", "c_ini", "y_thresh", "last_spike", "stdp_threshold", "weight_at",
        "hidden_delay", "input_bias", "clamp", "carry_state", "high_count",
    }  # fmt: skip


def test_optional_parts_may_be_absent(tmp_path):
    table = {k: v for k, v in GOOD.items() if k not in ("readings", "adaptation", "provenance")}
    network = Network.load(write(tmp_path, table, "champion.net.json"))
    assert network.readings == Readings()
    assert network.adaptation == Adaptation()
    assert network.name == "champion"
    table["adaptation"] = {"mu": 0.5}
    table["name"] = "called so"
    network = Network.load(write(tmp_path, table))
    assert network.adaptation == Adaptation(mu=0.5)
    assert network.name == "called so"


def test_a_network_without_synapses(tmp_path):
    network = Network.load(write(tmp_path, GOOD | {"synapses": []}))
    network.save(tmp_path / "empty.net.json")
    assert Network.load(tmp_path / "empty.net.json").synapses == ()


@pytest.mark.parametrize("text", ["@", '"synapses": "@"', '\n "synapses": "@"'])
def test_no_name_or_provenance_is_taken_for_the_synapses(tmp_path, text):
    network = Network.load(write(tmp_path, GOOD)).replace(provenance={"ohmloom": "x", "synapses": text})
    if text.isprintable():
        network = network.replace(name=text)
    network.save(tmp_path / "odd.net.json")
    assert Network.load(tmp_path / "odd.net.json") == network


def test_the_digest_is_of_behaviour(tmp_path):
    network = Network.load(write(tmp_path, GOOD))
    assert network.replace(name="other", provenance={}, adaptation=Adaptation()).sha256 == network.sha256
    assert network.replace(synapses=network.synapses[:2]).sha256 != network.sha256
    assert network.replace(readings=Readings(synapse_gain=0.5)).sha256 != network.sha256


def test_missing_file(tmp_path):
    path = tmp_path / "none.net.json"
    with pytest.raises(MissingFileError) as caught:
        Network.load(path)
    assert str(caught.value) == f"{path}: expected a network file, got No such file or directory. Check the path."
    assert isinstance(caught.value, FileNotFoundError)


def test_a_folder_is_not_a_file(tmp_path):
    with pytest.raises(MissingFileError, match="expected a network file, got Is a directory"):
        Network.load(tmp_path)


def test_saving_where_nothing_can_be_written(tmp_path):
    network = Network.load(write(tmp_path, GOOD))
    (tmp_path / "file").write_text("x")
    with pytest.raises(OperationError, match="expected a file that can be written"):
        network.save(tmp_path / "file" / "net.net.json")


def test_truncated_at_any_place(tmp_path):
    whole = json.dumps(GOOD)
    for length in range(0, len(whole), 37):
        message = refusal(tmp_path, whole[:length])
        assert message.startswith("FILE: expected JSON, got ")
        assert message.endswith("The file may be truncated.")


@pytest.mark.parametrize(("field", "value", "message"), [
    ("format", "ohmloom.plan",
     "FILE: format: expected 'ohmloom.network', got 'ohmloom.plan'. Check that this is the right file."),
    ("version", 2, "FILE: version: expected 1, got 2. This ohmloom reads only that one."),
    ("version", "1", "FILE: version: expected 1, got '1'. This ohmloom reads only that one."),
    ("version", 1.0, "FILE: version: expected 1, got 1.0. This ohmloom reads only that one."),
    ("version", True, "FILE: version: expected 1, got True. This ohmloom reads only that one."),
    ("hiden", 1, "FILE: hiden: expected no such key, got 1. Did you mean 'hidden'?"),
    ("xyzzy", 1, "FILE: xyzzy: expected no such key, got 1. Remove it."),
    ("readings.synapse_gian", 1.0,
     "FILE: readings.synapse_gian: expected no such key, got 1.0. Did you mean 'synapse_gain'?"),
    ("synapses[1].wieght", 0.5,
     "FILE: synapses[1].wieght: expected no such key, got 0.5. Did you mean 'weight'?"),
    ("adaptation.omgea", 0.5, "FILE: adaptation.omgea: expected no such key, got 0.5. Did you mean 'omega'?"),
    ("synapses[0].post", 9,
     "FILE: synapses[0]: expected no synapse from an input to an output, got 0 -> 9. Remove it."),
    ("synapses[0].post", 3,
     "FILE: synapses[0]: expected a hidden neuron or an output as postsynaptic neuron, got 0 -> 3. Remove it."),
    ("synapses[1].pre", 6,
     "FILE: synapses[1]: expected no synapse from a neuron to itself, got 6 -> 6. Remove it."),
    ("synapses[2].pre", 9,
     "FILE: synapses[2]: expected an input or a hidden neuron as presynaptic neuron, got 9 -> 10. Remove it."),
    ("synapses[0].post", 11, "FILE: synapses[0]: expected neurons 0 to 10, got 0 -> 11. Remove it."),
    ("synapses[0].pre", -1, "FILE: synapses[0]: expected neurons 0 to 10, got -1 -> 6. Remove it."),
    ("synapses[1]", {"pre": 6, "post": 8, "kind": "hp", "weight": 0.5},
     "FILE: synapses[1]: expected lateral synapses from a higher to a lower index "
     "(readings.lateral = 'descending'), got 6 -> 8. Remove it."),
    ("readings.lateral", "ascending",
     "FILE: synapses[1]: expected lateral synapses from a lower to a higher index "
     "(readings.lateral = 'ascending'), got 8 -> 6. Remove it."),
    ("synapses[2]", {"pre": 0, "post": 6, "kind": "linear", "weight": 0.5},
     "FILE: synapses[2]: expected each pair of neurons once, got 0 -> 6, which synapses[0] is too. Remove one."),
    ("synapses[0].weight", 0.25,
     "FILE: synapses[0].weight: expected 0.5 for a plastic synapse, got 0.25. Set it to 0.5."),
    ("synapses[0].kind", "constant",
     "FILE: synapses[0].kind: expected hp or peo_pani or linear in a HET network, got 'constant'. "
     "Change the kind or the system."),
    ("system", "HP",
     "FILE: synapses[1].kind: expected hp in a HP network, got 'peo_pani'. Change the kind or the system.\n"
     "FILE: synapses[2].kind: expected hp in a HP network, got 'linear'. Change the kind or the system."),
    ("synapses[0].weight", -0.1,
     "FILE: synapses[0].weight: expected greater than or equal to 0, got -0.1. Correct it."),
    ("synapses[0].weight", 1.5, "FILE: synapses[0].weight: expected less than or equal to 1, got 1.5. Correct it."),
])  # fmt: skip
def test_refusals_word_for_word(tmp_path, field, value, message):
    assert refusal(tmp_path, changed(field, value)) == message


@pytest.mark.parametrize("value", ["0", 1.0, True, None, [0]])
@pytest.mark.parametrize("field", ["synapses[0].pre", "synapses[0].post", "inputs", "outputs",
                                   "readings.last_spike", "readings.high_count"])  # fmt: skip
def test_only_integers_are_integers(tmp_path, field, value):
    message = refusal(tmp_path, changed(field, value))
    assert message.startswith(f"FILE: {field}: expected ")
    assert f"got {value!r}" in message


@pytest.mark.parametrize(("field", "value", "rule"), [
    ("inputs", 6.0, "a valid integer"), ("outputs", 2.0, "a valid integer"), ("inputs", 5, "6"), ("outputs", 3, "2"),
])  # fmt: skip
def test_the_layers_have_fixed_sizes(tmp_path, field, value, rule):
    message = refusal(tmp_path, changed(field, value))
    assert message == f"FILE: {field}: expected {rule}, got {value!r}. Correct it."


@pytest.mark.parametrize("value", ["0.5", True, None])
@pytest.mark.parametrize("field", ["synapses[0].weight", "readings.synapse_gain", "readings.a"])
def test_only_numbers_are_numbers(tmp_path, field, value):
    assert refusal(tmp_path, changed(field, value)).startswith(f"FILE: {field}: expected ")


@pytest.mark.parametrize("constant", ["NaN", "Infinity", "-Infinity"])
def test_not_a_number(tmp_path, constant):
    text = json.dumps(GOOD).replace('"weight": 0.5', f'"weight": {constant}', 1)
    assert refusal(tmp_path, text) == f"FILE: expected finite numbers, got {constant}. Replace it with a number."


def test_a_number_too_large_for_a_float(tmp_path):
    text = json.dumps(GOOD).replace('"weight": 0.5', '"weight": 1e999', 1)
    assert refusal(tmp_path, text).startswith("FILE: synapses[0].weight: expected ")


@pytest.mark.parametrize(("field", "value"), [
    ("hidden", []), ("hidden", ["exciting"]), ("hidden", "excitatory"), ("system", "HPP"), ("system", 3),
    ("readings.lateral", "sideways"), ("readings.synapse_gain", 0.0), ("readings.synapse_gain", -1.0),
    ("readings.clamp", 1), ("readings.carry_state", "true"), ("readings.high_count", 23), ("readings.b", 1.5),
    ("adaptation.mu", 0.0), ("adaptation.tau", 1.01), ("synapses[0].kind", "memristor"), ("synapses", {}),
    ("provenance", []), ("name", 3),
])  # fmt: skip
def test_other_rules_name_the_field(tmp_path, field, value):
    message = refusal(tmp_path, changed(field, value))
    assert message.startswith(f"FILE: {field}")
    assert ": expected " in message
    assert ", got " in message


@pytest.mark.parametrize("field", ["system", "inputs", "hidden", "outputs", "synapses"])
def test_missing_fields(tmp_path, field):
    table = {k: v for k, v in GOOD.items() if k != field}
    assert refusal(tmp_path, table) == f"FILE: {field}: expected a value, got nothing. Add it."


@pytest.mark.parametrize(("table", "start"), [
    ([], "FILE: expected an object with the key 'format', got []"), ({}, "FILE: format: expected 'ohmloom.network'"),
    ({"format": "ohmloom.network"}, "FILE: version: expected 1, got nothing"),
])  # fmt: skip
def test_other_files(tmp_path, table, start):
    assert refusal(tmp_path, table).startswith(start)


def test_a_key_that_stands_twice(tmp_path):
    text = json.dumps(GOOD).replace('"inputs": 6', '"inputs": 6, "inputs": 6')
    assert refusal(tmp_path, text) == "FILE: expected each key once, got 'inputs' twice. Remove one."


def test_text_that_is_not_utf8(tmp_path):
    path = tmp_path / "net.net.json"
    path.write_bytes(b'{"format": "\xff"}')
    with pytest.raises(FileFormatError, match="expected UTF-8 text"):
        Network.load(path)


def test_very_deep_nesting(tmp_path):
    assert refusal(tmp_path, "[" * 100000).startswith("FILE: expected a shallow JSON object")


def test_all_problems_come_in_one_error(tmp_path):
    table = changed("synapses[0].weight", 7.0)
    table["synapses"][1]["pre"] = "8"
    table["extra"] = None
    del table["outputs"]
    problems = refusal(tmp_path, table).splitlines()
    assert sorted(p.split(": ")[1] for p in problems) == [
        "extra",
        "outputs",
        "synapses[0].weight",
        "synapses[1].pre",
    ]

    table = changed("synapses[0].weight", 0.7)
    table["synapses"][1]["post"] = 8
    table["synapses"][2]["kind"] = "constant"
    problems = refusal(tmp_path, table).splitlines()
    assert [p.split(": ")[1] for p in problems] == ["synapses[0].weight", "synapses[1]", "synapses[2].kind"]


def test_replacing_fields_is_checked(tmp_path):
    network = Network.load(write(tmp_path, GOOD))
    with pytest.raises(ParameterError, match=r"Network\.synapses\[0\]: expected no synapse from a neuron to itself"):
        network.replace(synapses=(Synapse(6, 6, "hp", 0.5),))
    with pytest.raises(ParameterError, match=r"Network\.hidden: expected 'excitatory' or 'inhibitory'"):
        network.replace(hidden=(), synapses=())
    with pytest.raises(ParameterError, match=r"expected a number in \[0, 1\], got 1\.5"):
        network.replace(system="GA", synapses=(Synapse(0, 6, "constant", 1.5),))
    with pytest.raises(UnknownNameError, match=r"Network\.system: .* got 'HEP'\. Did you mean 'HP'\?"):
        network.replace(system="HEP")
    with pytest.raises(UnknownNameError, match=r"^Network\.replace: .* got 'hiden'\. Did you mean 'hidden'\?"):
        network.replace(hiden=())


def made(**changes):
    return Network(**({"system": "HP", "hidden": ("excitatory",), "synapses": (Synapse(0, 6, "hp", 0.5),)} | changes))


@pytest.mark.parametrize(("field", "value"), [
    ("synapses", (Synapse(0, 99, "hp", 0.5),)), ("synapses", (Synapse(0.0, 6, "hp", 0.5),)),
    ("synapses", (Synapse(True, 6, "hp", 0.5),)), ("synapses", (Synapse("0", 6, "hp", 0.5),)),
    ("synapses", (Synapse(0, 6, None, 0.5),)), ("synapses", (Synapse(0, 6, "hp", "a"),)),
    ("synapses", (Synapse(0, 6, "hp", np.nan),)), ("synapses", ((0, 6, "hp"),)), ("synapses", (3,)),
    ("synapses", 3), ("synapses", None), ("synapses", "0"), ("hidden", None), ("hidden", "+"), ("hidden", (1,)),
    ("hidden", ([],)), ("hidden", ("excitatory",) * 1001), ("system", None), ("system", ["HP"]), ("readings", {}),
    ("adaptation", None), ("provenance", None), ("provenance", {"a": np.nan}), ("provenance", {"a": [1e999]}),
    ("provenance", {1: 2}), ("provenance", {"a": object()}), ("provenance", {"a": 10**5000}), ("name", None),
    ("name", "a\nb"), ("name", "\ud800"), ("name", "x" * 101), ("name", "a\x00"),
])  # fmt: skip
def test_a_network_made_in_python_is_checked(field, value):
    with pytest.raises(ParameterError, match=rf"^Network\.{field}.*: expected .*, got ") as caught:
        made(**{field: value})
    assert "\n" not in str(caught.value)


def test_lists_and_scalars_of_numpy_become_plain():
    network = made(hidden=["excitatory"], synapses=[[np.int64(0), np.uint8(6), "hp", np.float64(0.5)]],
                   provenance={"seed": np.int64(3), "all": (np.float32(0.5), True)})  # fmt: skip
    assert network == made(provenance={"seed": 3, "all": [0.5, True]})
    assert type(network.synapses[0].pre) is int
    assert type(network.synapses[0].weight) is float
    assert json.loads(network.to_json())["provenance"]["seed"] == 3


def test_provenance_is_a_copy():
    notes = {"runs": [1]}
    network = made(provenance=notes)
    notes["runs"].append(2)
    assert network.provenance == {"runs": [1]}


def test_files_with_a_name_or_provenance_that_cannot_be_kept(tmp_path):
    assert refusal(tmp_path, GOOD | {"name": "a\nb"}).startswith("FILE: name: expected at most 100 printable")
    text = json.dumps(GOOD).replace('"generation": 40', '"generation": 1e999')
    assert refusal(tmp_path, text).startswith("FILE: provenance: expected a finite number, got inf.")
    assert refusal(tmp_path, GOOD | {"hidden": ["excitatory"] * 1001}).startswith("FILE: hidden: expected ")


def test_an_odd_file_name_gives_a_plain_name(tmp_path):
    assert Network.load(write(tmp_path, GOOD, "a\nb" + "x" * 150 + ".net.json")).name == "a?b" + "x" * 97


@pytest.mark.parametrize(("name", "value"), [
    ("rng", None), ("rng", 3), ("hidden", 2.5), ("hidden", "9"), ("hidden", True), ("hidden", 1001),
    ("enable_probability", "a"), ("enable_probability", None), ("enable_probability", np.nan), ("readings", {}),
    ("system", None),
])  # fmt: skip
def test_random_networks_refuse_wrong_types(name, value):
    with pytest.raises(ParameterError, match=rf"^Network\.random\.{name}: expected .*, got "):
        Network.random(**({"system": "HP", "rng": np.random.default_rng(1)} | {name: value}))


@pytest.mark.parametrize("path", [None, 5, b"x"])
def test_what_is_no_path(path):
    with pytest.raises(ParameterError, match=r"^network file: expected a path, got "):
        Network.load(path)


def test_controllers_and_mutations_want_networks():
    for where, call in (("SpikingController.network", SpikingController),
                        ("mutate.parent", lambda n: mutate(n, rng=np.random.default_rng(1)))):  # fmt: skip
        with pytest.raises(ParameterError, match=rf"^{where}: expected Network, got 'HP'\."):
            call("HP")
