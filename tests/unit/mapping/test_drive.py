"""Waveforms and pulse shapes on the emulated array, and what a spec must not ask for."""

import math

import numpy as np
import pytest

from ohmloom.errors import FileFormatError, MappingError
from ohmloom.mapping import EmulatedController, Hardware, place
from ohmloom.mapping.pulses import pulse_area
from ohmloom.neurocontroller import Network

NETWORK = Network.random(system="HET", rng=np.random.default_rng(3))
QUANTITY = {"source": "definition: a test"}
HALVES = {"row": (0.0, 0.0, -1.0, 1.0), "column": (0.0, 0.0, -1.0, 1.0), "duration": 0.5}
FIXED = {"mode": "voltage", "parallelism": "column", "pulse_duration": 1e-3}

# waveform, more keys of the drive, threshold at 1 V
WRITTEN = {
    "two_part": ({}, 0.9),
    "two_slot": ({}, 0.9),
    "pwm": ({}, 0.75),
    "levels": ({"levels": (0.0, 0.0, -2.0, 2.0)}, 0.75),
    "phases": ({"phases": (HALVES, HALVES)}, 0.75),
}


def trial(hardware):
    emulated = EmulatedController(place(NETWORK, hardware).nominal())
    spikes = []
    for sensors in np.random.default_rng(1).random((25, 6)):
        emulated.step(sensors)
        spikes.append(emulated.spike_counts.tolist())
    return spikes, emulated


@pytest.mark.parametrize("name", WRITTEN)
def test_every_waveform_writes_what_half_writes(name, changed):
    more, threshold = WRITTEN[name]
    waveform = "user" if more else name
    wanted, half = trial(Hardware.load("ideal"))
    spikes, emulated = trial(changed("ideal", drive={"waveform": waveform, "threshold": threshold, **more}))
    assert spikes == wanted
    # Two half events are one whole event up to rounding.
    np.testing.assert_allclose(emulated.weights, half.weights, rtol=0, atol=1e-12 if name == "phases" else 0)
    assert (emulated.ledger.events, emulated.ledger.lost, emulated.ledger.spurious) == (half.ledger.events, 0, 0)
    assert half.ledger.events > 100


@pytest.mark.parametrize(
    ("shape", "edge", "slot"),
    [
        ("trapezoid", 2e-4, None), ("trapezoid", 2e-4, 1.2e-3), ("trapezoid", 2e-4, 1.1e-3), ("trapezoid", 2e-4, 7e-4),
        ("rc", 2e-4, None), ("rc", 2e-4, 1.5e-3), ("rc", 2e-4, 1e-3), ("rc", 2e-4, 7e-4),
    ],
)  # fmt: skip
def test_area_of_a_pulse_is_the_integral_of_its_shape(shape, edge, slot, changed):
    duration = 1e-3
    drive = changed("ideal", drive=FIXED | {"pulse_shape": shape, "edge": edge, "slot": slot}).drive
    t = np.linspace(0.0, slot or 20e-3, 400_001)
    if shape == "trapezoid":
        height = np.interp(t, [0.0, edge, duration, duration + edge], [0.0, 1.0, 1.0, 0.0])
    else:
        top = 1.0 - math.exp(-duration / edge)
        height = np.where(t < duration, 1.0 - np.exp(-t / edge), top * np.exp(-(t - duration) / edge))
    # 1e-6: the trapezoid rule on steps of a twenty-thousandth of a pulse or less.
    assert pulse_area(drive) == pytest.approx(np.trapezoid(height, t) / duration, abs=1e-6)
    assert (pulse_area(drive) < 1.0 - 1e-4) == (slot is not None and slot != 1.2e-3)


def test_a_pulse_that_is_cut_moves_less(changed):
    whole, cut = (
        trial(changed("ideal", drive=FIXED | {"pulse_shape": "rc", "edge": 2e-4, "slot": slot}))[1]
        for slot in (None, 1e-3)
    )
    plain = trial(changed("ideal", drive=FIXED))[1]
    assert (whole.weights == plain.weights).all()
    assert (cut.weights != plain.weights).any()


@pytest.mark.parametrize(
    ("spec", "sections", "message"),
    [
        ("hp_passive", {"drive": {"mode": "current", "pulse_duration": 1e-3}},
         r"drive\.mode: expected 'voltage' on a passive array, got 'current'\. Current and meters need one"),
        ("hp_passive", {"drive": {"mode": "charge_metered", "parallelism": "column"}},
         r"drive\.mode: expected 'voltage' on a passive array, got 'charge_metered'"),
        ("hp_passive", {"drive": {"parallelism": "column"}},
         r"drive\.parallelism: expected 'array' on a passive array, got 'column'"),
        ("hp_passive", {"array": {"disabled": "masked"}},
         r"array: expected disabled 'unformed' or 'present' with access = 'passive': only a transistor can mask"),
        ("ideal", {"drive": {"threshold": 0.4}},
         r"drive\.threshold: expected no event for ls \(pre, post\) = \(0, 2\), got a negative event at -0\.5 V "
         r"against a threshold of 0\.4 V\. Choose a threshold from 0\.5 V, .* to below 1 V"),
        ("ideal", {"drive": {"threshold": 1.1}},
         r"drive\.threshold: expected a positive event for ls \(pre, post\) = \(2, 3\), got no event at 1 V"),
        ("ideal", {"drive": {"waveform": "user", "levels": (0.0, -1.0, -1.0, 1.0)}},
         r"\(1, 3\), got a positive event .*No threshold separates this waveform: .*\(1, 3\).* fire wrongly at any"),
        ("ideal", {"nonidealities": {"event_charge": -0.1}},
         r"nonidealities\.event_charge: expected a value and range >= 0, not -0\.1"),
        ("ideal", {"nonidealities": {"stuck_on": 1.5}},
         r"nonidealities\.stuck_on: expected a value and range in \[0, 1\]"),
        ("ideal", {"nonidealities": {"quantisation": 2.5}},
         r"nonidealities\.quantisation: expected a whole number from 1 to 32, not 2\.5"),
        ("ideal", {"nonidealities": {"read_nois": 0.1}},
         r"nonidealities\.read_nois: expected no such key, .*Did you mean 'read_noise'\?"),
        ("ideal", {"drive": {"slot": 1e-3}},
         r"drive: expected slot with pulse_duration and a pulse_shape that has edges"),
        ("ideal", {"drive": {"pulse_shape": "rc"}}, r"drive: expected edge with pulse_shape = 'trapezoid' or 'rc'"),
        ("ideal", {"drive": {"levels": (0.0, 0.0, -1.0, 1.0)}},
         r"drive: expected either levels or phases with waveform = 'user'"),
        ("ideal", {"wires": {"r_row": 1e-3}},
         r"drive\.parallelism: expected 'cell' or 'column' for current pulses through wires, got 'array'"),
        # An effect that nothing would show.
        ("ideal", {"nonidealities": {"wire_resistance": 0.1}},
         r"nonidealities\.wire_resistance: expected none, since the wires have no resistance, got 0\.1\. Leave it out"),
        ("ideal", {"nonidealities": {"metering_delay": 0.1}},
         r"nonidealities\.metering_delay: expected none, since drive\.mode is 'current', which has no meter"),
        ("hp_1t1r", {"nonidealities": {"half_select": 0.1}},
         r"nonidealities\.half_select: expected none, since only selected cells see a programming voltage"),
        ("ideal", {"nonidealities": {"half_select": 0.1}},
         r"nonidealities\.half_select: expected none, since drive\.mode is 'current', which puts no voltage on lines"),
        ("ideal", {"nonidealities": {"quantisation": 4.0}, "converter": {"bits": {"value": 4.0, **QUANTITY}}},
         r"nonidealities\.quantisation: expected none, since converter\.bits says it already, got 4"),
        ("ideal", {"environment": {"temperature": 310.0, "card_temperature": 300.0, "retention_activation": 0.5}},
         r"environment\.retention_activation: expected nonidealities\.retention beside it"),
        ("ideal", {"environment": {"temperature": 310.0, "card_temperature": 300.0, "drift_activation": 0.5}},
         r"environment\.drift_activation: expected drive\.mode 'voltage' or 'exact_width' beside it, got 'current'"),
    ],
)  # fmt: skip
def test_what_hardware_cannot_do_is_refused(spec, sections, message, changed):
    with pytest.raises(FileFormatError, match=message):
        changed(spec, **sections)


def test_an_effect_of_nothing_is_not_refused(changed):
    changed("ideal", nonidealities={"metering_delay": 0.0, "wire_resistance": 0.0})


def test_a_kind_without_a_card_is_refused():
    with pytest.raises(MappingError, match=r"peo_pani.*hp_1t1r|hp_1t1r.*peo_pani"):
        place(NETWORK, Hardware.load("hp_1t1r"))


def test_an_array_without_room_for_a_line_names_the_first_synapse(changed):
    spec = changed("ideal", array={"max_columns": 1})
    with pytest.raises(
        MappingError, match=r"array\.max_columns: expected at least 2 for the linear tile .* got 1; synapses\[\d+\]"
    ):
        place(Network.random(system="LIN", rng=np.random.default_rng(1)), spec)


def test_a_device_that_a_width_cannot_be_computed_for_is_refused(changed):
    spec = changed("peo_pani_redox", drive={"mode": "exact_width"})
    with pytest.raises(
        MappingError, match=r"drive\.mode: expected 'charge_metered' or 'voltage' for the kind peo_pani"
    ):
        place(Network.random(system="PEO", rng=np.random.default_rng(1)), spec)
