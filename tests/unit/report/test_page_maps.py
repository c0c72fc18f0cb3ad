"""Numbers behind the report's crossbar maps."""

import numpy as np
import pytest

from ohmloom.mapping import EmulatedController, Hardware, place
from ohmloom.neurocontroller import champion
from ohmloom.report._page_maps import end_conductances
from ohmloom.sim import Arena, agreement, run_trial

SHORT = Arena(task="static", max_timesteps=5)


@pytest.mark.parametrize("signs", ["row_polarity", "differential_pair"])
def test_conductances_after_a_trial_are_those_of_the_die(signs: str) -> None:
    hardware = Hardware.load("ideal")
    hardware = hardware.model_copy(update={"array": hardware.array.model_copy(update={"signs": signs})})
    network = champion("HET")
    plan = place(network, hardware)
    die = EmulatedController(plan.nominal())
    run_trial(die, SHORT, trial_key=1)
    found = end_conductances(plan, agreement(network, hardware, arena=SHORT, die=plan.nominal(), trial_key=1))
    # W and back rounds a little.
    np.testing.assert_allclose(found, die.conductances, rtol=1e-12)
