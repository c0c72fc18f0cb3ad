"""Hardware specs: what is shipped loads, what is wrong is refused with file, field, value and rule."""

from importlib import resources

import pytest

from ohmloom.errors import FileFormatError, MissingFileError, UnknownNameError
from ohmloom.mapping import Hardware
from ohmloom.mapping.hardware import UNITS

TEXT = (resources.files("ohmloom.mapping") / "specs" / "het_mixed.toml").read_text()


def load(tmp_path, text):
    path = tmp_path / "hw.toml"
    path.write_text(text)
    return Hardware.load(path)


@pytest.mark.parametrize("name", Hardware.names())
def test_shipped_specs_load_with_a_source_for_every_value(name):
    hardware = Hardware.load(name)
    assert hardware.name == name
    assert "constant" in hardware.cards
    assert {"hp", "peo_pani"} & set(hardware.cards)
    for key, quantity in hardware.quantities().items():
        assert quantity.source, key
        assert key in UNITS


def test_het_mixed_builds_every_kind():
    assert list(Hardware.load("het_mixed").devices) == ["hp", "peo_pani", "linear", "constant"]


def test_path_and_name_give_the_same(tmp_path):
    assert load(tmp_path, TEXT).sha256 == Hardware.load("het_mixed").sha256


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            'mode = "charge_metered"',
            'mode = "hammer"',
            r"drive\.mode: expected 'charge_metered', 'current', 'voltage' or 'exact_width'",
        ),
        ("max_rows = 64", "max_rows = 0", r"hw\.toml: array\.max_rows: expected greater than or equal to 1, got 0"),
        ("max_rows = 64", "max_row = 64", r"array\.max_row: expected no such key, got 64\. Did you mean 'max_rows'\?"),
        ("r_row = { value = 1.06", "r_row = { value = -1.0", r"wires\.r_row: expected a range around the value -1"),
        ("pulses = { value = 1e9", "pulses = { value = -1.0", r"endurance\.pulses"),
        ("value = 0.75", "value = nan", r"drive\.threshold\.value: expected a finite number, got nan"),
        ("value = 0.75", 'value = "0.75"', r"drive\.threshold\.value: expected a valid number, got '0\.75'"),
        (", range = [0.8, 1.4]", "", r"drive\.pulse_voltage: expected a range"),
        ("range = [0.8, 1.4]", "range = [1.1, 1.4]", r"drive\.pulse_voltage: expected a range around the value 1"),
        ('hp = "hp_tio2_10k"', 'hpp = "hp_tio2_10k"', r"cards: expected only hp, peo_pani, linear, constant"),
        ('hp = "hp_tio2_10k"', 'hp = "linear"', r"cards\.hp: expected a memristive card, got 'linear'"),
        ("version = 1", "version = 2", r"hw\.toml: version: expected 1, got 2"),
        ('format = "ohmloom.hardware"', 'format = "ohmloom.network"', r"format: expected 'ohmloom\.hardware'"),
        ("[wires]", "[wires", r"hw\.toml: expected TOML, got .*The file may be truncated"),
        ("range = [0.8, 1.4]", "range = [0.5, 2.0]", r"drive\.threshold: expected a positive event .* at 0\.5 V"),
        ('parallelism = "column"', 'parallelism = "array"', r"drive: expected parallelism 'cell' or 'column'"),
        ("{ value = 0.1, ", "{ value = 0.9, ", r"read\.voltage"),
        ("range = [0.05, 0.5]", "range = [0.05, 0.8]", r"read\.voltage: expected less than drive\.threshold = 0\.75 V"),
        ('mode = "charge_metered"', 'mode = "current"', r"drive: expected pulse_duration with mode = 'current'"),
    ],
)  # fmt: skip
def test_bad_spec_is_refused(tmp_path, old, new, message):
    assert old in TEXT
    with pytest.raises(FileFormatError, match=message):
        load(tmp_path, TEXT.replace(old, new, 1))


def test_all_problems_come_in_one_error(tmp_path):
    text = TEXT.replace("max_rows = 64", "max_rows = 0").replace('waveform = "half"', 'waveform = "sine"')
    with pytest.raises(FileFormatError) as caught:
        load(tmp_path, text)
    assert len(caught.value.problems) == 2


def test_unknown_name_offers_the_nearest():
    with pytest.raises(UnknownNameError, match=r"got 'het_mixd'\. Did you mean 'het_mixed'\?"):
        Hardware.load("het_mixd")


def test_missing_file_is_named(tmp_path):
    with pytest.raises(MissingFileError, match=r"nothing\.toml: expected a hardware spec file, got No such file"):
        Hardware.load(tmp_path / "nothing.toml")
