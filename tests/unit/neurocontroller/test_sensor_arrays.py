"""Sensor values of any layout run the same compiled code."""

import numpy as np

from ohmloom.neurocontroller.controller import checked_sensors


def test_locked_and_strided_values_become_a_plain_array():
    locked = np.linspace(0.0, 1.0, 6)
    locked.flags.writeable = False
    for given in (locked, np.linspace(0.0, 1.0, 12)[::2], [0, 0, 0, 1, 1, 1]):
        values = checked_sensors("step", given)
        assert values.flags.writeable
        assert values.flags.c_contiguous
        assert values.tolist() == [float(value) for value in given]
