"""Pictures of crossbars: what they show is what the read gives."""

import numpy as np
import pytest

from ohmloom.circuits import Crossbar, PulseTrain, plot_crossbar, plot_schematic
from ohmloom.errors import ParameterError, UnknownNameError

ARRAY = Crossbar(conductance=np.array([[1e-3, 2e-3, 0.0], [4e-4, 5e-4, 6e-4]]), r_row=10.0, r_column=5.0)
VOLTS = np.array([1.0, -0.5])


@pytest.mark.parametrize(
    ("what", "wanted", "label"),
    [
        ("conductance", lambda r: ARRAY.conductance * 1e3, "conductance [mS]"),
        ("current", lambda r: r.device_current * 1e3, "current through the device [mA]"),
        ("v_row", lambda r: r.v_row, "potential of the row's node [V]"),
        ("v_column", lambda r: r.v_column * 1e3, "potential of the column's node [mV]"),
        ("ir_drop", lambda r: (VOLTS[:, None] - (r.v_row - r.v_column)) * 1e3, "voltage lost in wires"),
    ],
)
def test_heat_maps_show_the_values_of_the_read_in_the_unit_of_their_label(what, wanted, label):
    ax = plot_crossbar(ARRAY, VOLTS, what=what)
    assert np.allclose(ax.images[0].get_array(), wanted(ARRAY.read(VOLTS)))
    assert ax.figure.axes[1].get_ylabel().startswith(label)


def test_the_schematic_names_every_device_every_drive_and_every_current():
    ax = plot_schematic(ARRAY, VOLTS)
    said = [text.get_text() for text in ax.texts]
    assert {"1 mS", "2 mS", "400 uS", "500 uS", "600 uS"} <= set(said)
    assert "row 1\n-500 mV" in said
    current = ARRAY.read(VOLTS).current[0] * 1e3
    assert f"column 0\n{current:.3g} mA" in said or f"column 0\n{current * 1e3:.3g} uA" in said
    assert "rows 10 Ohm, columns 5 Ohm" in ax.get_title()


def test_pulses_are_drawn_line_by_line_to_one_scale():
    train = PulseTrain.rectangular([[2.0, -1.0]], columns=1, width=1e-6, edge=1e-8, period=2e-6)
    ax = train.plot()
    assert [label.get_text() for label in ax.get_yticklabels()] == ["row 0", "row 1", "column 0"]
    heights = [np.ptp(line.get_ydata()) for line in ax.lines if len(line.get_ydata()) == train.t.size]
    assert heights[0] == pytest.approx(2 * heights[1])
    assert heights[2] == 0.0


def test_what_cannot_be_drawn_is_refused_by_name():
    with pytest.raises(UnknownNameError, match="ir_drop"):
        plot_crossbar(ARRAY, VOLTS, what="ir_dro")
    with pytest.raises(ParameterError, match="expected voltages of the rows for 'current', got none"):
        plot_crossbar(ARRAY, what="current")
    with pytest.raises(ParameterError, match="expected one crossbar"):
        plot_crossbar(Crossbar(conductance=np.ones((2, 2, 2))))
    with pytest.raises(ParameterError, match="expected one pattern"):
        plot_crossbar(ARRAY, np.ones((3, 2)), what="current")
    with pytest.raises(ParameterError, match="at most 8 x 8"):
        plot_schematic(Crossbar(conductance=np.ones((9, 2))))
