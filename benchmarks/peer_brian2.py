"""One network in Brian2 (C++ standalone), open loop: the peer that ``peers.py`` builds. Needs Brian2, not ohmloom.

Run: python benchmarks/peer_brian2.py NETWORK FOLDER. NETWORK is a file of ``peers.py``; the program is built in FOLDER
with Brian2's own compiler flags, run once, and what it found is printed as JSON.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from brian2 import (
    Network,
    NeuronGroup,
    SpikeMonitor,
    Synapses,
    TimedArray,
    defaultclock,
    device,
    ms,
    set_device,
)

INPUTS, STEPS = 6, 21

# Eqs. 3 and 4. `recent` is 1 for a neuron that spiked in the last step and not in this: the old ones of eqs. 10 and 11.
STEP = """
y = clip(y + (sensors(t, i) + gain * arrived + a - b * y), 0, inf)
recent = spiked * int(y <= 1)
spiked = int(y > 1)
arrived = 0
"""
# Eqs. 7, 9 and 12 for one kind of synapse, on the integer charges of ohmloom's lattice, with the same expressions.
WEIGHTS = {
    "hp": "0.01 / (1 - q / 100000)",
    "peo_pani": "1.01 - 0.01 / (0.01 + q / 5100000)",
    "linear": "q / 1000",
}
MOVE = """
q = clip(q {sign} {event} * recent_{other}, 0, {top})
w = {weight}
"""


def synapses(group: NeuronGroup, kind: str, table: dict[str, list[Any]], lattice: dict[str, int]) -> Synapses:
    """The synapses of one kind; those of another would only add branches to every event."""

    def move(sign: str, other: str) -> str:
        return MOVE.format(sign=sign, other=other, event=lattice["event"], top=lattice["top"], weight=WEIGHTS[kind])

    held = Synapses(
        group,
        group,
        "q : 1\nw : 1\npolarity : 1 (constant)",
        on_pre={"fall": move("-", "post"), "deliver": "arrived_post += polarity * w"},
        on_post={"rise": move("+", "pre")},
    )
    held.connect(i=table["pre"], j=table["post"])
    # A spike acts in the step after its delivery, with the weight that the events of the step before have left.
    held.fall.order, held.rise.order, held.deliver.order = 0, 1, 2
    held.deliver.delay = (np.array(table["delay"]) - 1) * defaultclock.dt
    held.polarity = table["sign"]
    held.q = lattice["start"]
    held.w = WEIGHTS[kind]
    return held


def main(source: Path, folder: Path) -> None:
    """Build, run once, report."""
    case = json.loads(source.read_text())
    set_device("cpp_standalone", build_on_run=False)
    defaultclock.dt = 1 * ms
    readings = case["readings"]
    values = np.zeros((len(case["sensors"]), case["neurons"]))
    values[:, :INPUTS] = case["sensors"]
    names = {"sensors": TimedArray(values, dt=STEPS * ms), "gain": readings["synapse_gain"]}
    names |= {"a": readings["a"], "b": readings["b"]}
    group = NeuronGroup(
        case["neurons"],
        "y : 1\narrived : 1\nspiked : 1\nrecent : 1",
        threshold="spiked > 0",
        reset="y = 0",
        namespace=names,
    )
    group.run_regularly(STEP, when="groups")
    group.y = readings["c_ini"]
    held = {kind: synapses(group, kind, table, case["lattices"][kind]) for kind, table in case["synapses"].items()}
    counter = SpikeMonitor(group, record=False)
    network = Network(group, *held.values(), counter)
    begin = time.perf_counter()
    network.run(len(case["sensors"]) * STEPS * ms)
    device.build(directory=str(folder), compile=True, run=False, debug=False)
    build = time.perf_counter() - begin
    device.run()
    found = {"build": build, "counts": np.asarray(counter.count[:]).tolist()}
    found["weights"] = {kind: np.asarray(s.w[:]).tolist() for kind, s in held.items()}
    print(json.dumps(found))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
