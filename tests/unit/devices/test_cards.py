"""Cards: what is shipped, and what each broken file is told."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from importlib import resources

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ohmloom.devices import LAWS, CardValue, Device
from ohmloom.devices.card import parse_card, read_card, write_card
from ohmloom.errors import FileFormatError, MissingFileError

SHIPPED = [
    "constant",
    "hp_tio2",
    "hp_tio2_10k",
    "hp_tio2_paper",
    "linear",
    "linear_paper",
    "peo_pani",
    "peo_pani_paper",
    "peo_pani_redox",
    "pickett",
    "vteam_memtorch",
    "yakopcic_miao",
]
GOOD = """\
format = "ohmloom.device"
version = 1
name = "mine"
law = "hp_linear"
source = "measured here"

[parameters.r_on]
value = 100
source = "fit"
interval = [90, 110.0]

[parameters.r_off]
value = 16e3
source = "fit"

[parameters.beta]
value = 100.0
source = "fit"
"""


def shipped_bytes(name):
    return (resources.files("ohmloom.devices") / "cards" / f"{name}.toml").read_bytes()


def test_the_shipped_cards_are_these():
    assert Device.names() == SHIPPED


@pytest.mark.parametrize("name", SHIPPED)
def test_every_shipped_card_loads_and_has_a_source_for_every_value(name):
    device = Device.load(name)
    assert device.name == name
    assert device.source
    assert set(device.sources) == set(device.parameters) == set(LAWS[device.law].parameter_names)
    assert all(len(source) > 20 for source in device.sources.values())


@pytest.mark.parametrize("name", SHIPPED)
def test_a_shipped_card_is_what_save_writes_so_its_digest_is_the_files(name, tmp_path):
    device = Device.load(name)
    device.save(tmp_path / "card.toml")
    assert (tmp_path / "card.toml").read_bytes() == shipped_bytes(name)
    assert device.sha256 == hashlib.sha256(shipped_bytes(name)).hexdigest()
    assert Device.load(tmp_path / "card.toml") == device


def test_shipped_values_are_those_of_the_design():
    wanted = {
        "hp_tio2": {"r_on": 100.0, "r_off": 16e3, "beta": 100.0},
        "hp_tio2_10k": {"r_on": 1e4, "r_off": 1e6, "beta": 100.0},
        "hp_tio2_paper": {"r_on": 0.01, "r_off": 1.0, "beta": 100.0},
        "peo_pani_paper": {"r_on": 0.01, "r_off": 1.0, "q_d": 0.99},
        "linear_paper": {"r_on": 0.01, "r_off": 1.0, "q_d": 0.99},
    }
    for name, parameters in wanted.items():
        assert Device.load(name).parameters == parameters
    for name in ("linear", "constant"):
        assert Device.load(name).charge_scale == Device.load("hp_tio2_10k").charge_scale
        assert "assumed" in Device.load(name).sources["q_d"]


def test_polyaniline_scales_come_from_data():
    device = Device.load("peo_pani")
    assert 1 / device.parameters["r_on"] == pytest.approx(87e-6, rel=1e-3)
    assert device.weight(0.0) == pytest.approx(0.01, rel=1e-12)
    assert device.charge_scale == 0.34e-3
    assert device.intervals["q_d"] == (0.10e-3, 0.64e-3)
    assert "research-team/memristive-brain" in device.sources["q_d"]


def test_a_card_file_is_loaded_by_path(tmp_path):
    (tmp_path / "mine.toml").write_text(GOOD)
    for path in (tmp_path / "mine.toml", str(tmp_path / "mine.toml")):
        device = Device.load(path)
        assert device.parameters == {"r_on": 100.0, "r_off": 16e3, "beta": 100.0}
        assert device.intervals == {"r_on": (90.0, 110.0), "r_off": None, "beta": None}


@given(
    st.text(st.characters(exclude_categories=["Cs"]), min_size=1),
    st.floats(1e-3, 1e3),
    st.floats(2e3, 1e9),
    st.floats(0.5, 1.0),
)
def test_any_card_survives_writing_and_reading(text, r_on, r_off, factor):
    values = (
        CardValue(value=r_on, source=text, interval=(r_on * factor, r_on / factor)),
        CardValue(value=r_off, source=text),
        CardValue(value=1e-6, source=text),
    )
    device = Device(name=text, law="linear", source=text, values=values)
    card = parse_card(device._card_text().encode(), "x")
    assert (card.name, card.source, card.values) == (text, text, values)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            'law = "hp_linear"',
            'law = "hp_linar"',
            f"x.toml: law: expected one of {', '.join(sorted(LAWS))}, got 'hp_linar'. Did you mean 'hp_linear'?",
        ),
        ('law = "hp_linear"', "", "x.toml: law: expected a value, got nothing. Add it."),
        ('law = "hp_linear"', "law = 3", "x.toml: law: expected a valid string, got 3. Correct it."),
        (
            'source = "measured here"',
            'sorce = "measured here"',
            "x.toml: source: expected a value, got nothing. Add it.\n"
            "x.toml: sorce: expected no such key, got 'measured here'. Did you mean 'source'?",
        ),
        (
            "[parameters.r_on]",
            "[parameters.ron]",
            "x.toml: parameters.r_on: expected a value, got nothing. Add it.\n"
            "x.toml: parameters.ron: expected no such key, got "
            "{'value': 100, 'source': 'fit', 'interval': [90, 110.0]}. Did you mean 'r_on'?",
        ),
        (
            "value = 100\n",
            "valu = 100\n",
            "x.toml: parameters.r_on.value: expected a value, got nothing. Add it.\n"
            "x.toml: parameters.r_on.valu: expected no such key, got 100. Did you mean 'value'?",
        ),
        (
            'value = 16e3\nsource = "fit"',
            "value = 16e3",
            "x.toml: parameters.r_off.source: expected a value, got nothing. Add it.",
        ),
        (
            'value = 16e3\nsource = "fit"',
            'value = 16e3\nsource = ""',
            "x.toml: parameters.r_off.source: expected String should have at least 1 character, got ''. Correct it.",
        ),
        (
            "value = 100\n",
            'value = "hello"\n',
            "x.toml: parameters.r_on.value: expected a valid number, got 'hello'. Correct it.",
        ),
        (
            "value = 100\n",
            "value = true\n",
            "x.toml: parameters.r_on.value: expected a valid number, got True. Correct it.",
        ),
        (
            "value = 16e3",
            "value = nan",
            "x.toml: parameters.r_off.value: expected a finite number, got nan. Correct it.",
        ),
        (
            "value = 100\n",
            "value = -100\n",
            "x.toml: parameters.r_on.value: expected 0.001 <= r_on <= 1000000000000 Ohm, got -100 Ohm. "
            "Raise it; check its unit.\n"
            "x.toml: parameters.r_on.interval: expected low <= value <= high with value = -100, "
            "got [90, 110]. Correct the interval or the value.",
        ),
        (
            "value = 100.0",
            "value = 1e40",
            "x.toml: parameters.beta.value: expected 1e-09 <= beta <= 1e+15 1/(V s), got 1e+40 1/(V s). "
            "Lower it; check its unit.",
        ),
        (
            "value = 16e3",
            "value = 100",
            "x.toml: parameters.r_on.value: expected 0 < r_on < r_off = 100 Ohm, got 100 Ohm. "
            "Lower r_on or raise r_off.",
        ),
        (
            "interval = [90, 110.0]",
            "interval = [90]",
            "x.toml: parameters.r_on.interval: expected List should have at least 2 items after validation, "
            "not 1, got [90]. Correct it.",
        ),
        (
            "interval = [90, 110.0]",
            "interval = [110, 90]",
            "x.toml: parameters.r_on.interval: expected low <= value <= high with value = 100, "
            "got [110, 90]. Correct the interval or the value.",
        ),
        (
            "version = 1",
            "version = 2",
            "x.toml: version: expected 1, got 2. This ohmloom reads only that one.",
        ),
        (
            '"ohmloom.device"',
            '"ohmloom.hardware"',
            "x.toml: format: expected 'ohmloom.device', got 'ohmloom.hardware'. Check that this is the right file.",
        ),
    ],
)
def test_a_broken_card_is_told_file_field_rule_and_value(old, new, message):
    assert GOOD.count(old) == 1
    with pytest.raises(FileFormatError) as caught:
        parse_card(GOOD.replace(old, new).encode(), "x.toml")
    assert str(caught.value) == message


def test_a_truncated_card_is_refused():
    with pytest.raises(FileFormatError, match=r"^x\.toml: expected TOML, got .* The file may be truncated\.$"):
        parse_card(GOOD[:45].encode(), "x.toml")


def test_an_unknown_card_name_offers_the_nearest(tmp_path):
    with pytest.raises(MissingFileError) as caught:
        Device.load("hp_tio")
    assert str(caught.value) == (
        f"Device.load: expected one of {', '.join(SHIPPED)}, got 'hp_tio'. Did you mean 'hp_tio2'? "
        "A card file is given by its path, ending in .toml."
    )
    missing = tmp_path / "mine.toml"
    with pytest.raises(MissingFileError) as caught:
        Device.load(missing)
    assert (
        str(caught.value) == f"{missing}: expected a device card file, got No such file or directory. Check the path."
    )


def test_writing_a_card_twice_gives_the_same_bytes():
    assert write_card(read_card("peo_pani")) == write_card(read_card("peo_pani"))


def test_the_room_imports_neither_numba_nor_scipy_nor_matplotlib():
    code = (
        "import sys; from ohmloom.devices import Device; Device.load('hp_tio2').weight(0.5);"
        "print([m for m in ('numba', 'scipy', 'matplotlib') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
