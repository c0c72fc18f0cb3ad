"""One die as arrays, for the kernels.

A *cell* is a crosspoint that conducts: a synapse's device, or what stands where no synapse is. Cells are sorted by
receiver, then sender, then tile, so that the fast read of a column is one run in the order in which the discrete
controller sums.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ohmloom._arrays import FloatArray, IntArray
from ohmloom.devices.laws import LAWS

BoolArray = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.uint64]
CELL, COLUMN, ARRAY = 0, 1, 2
CHARGE_METERED, CURRENT, VOLTAGE, EXACT_WIDTH = 0, 1, 2, 3
# Entries of `table`: what the rule asks for, and whether a device may see more than the lowest threshold.
WANTED_UP, WANTED_DOWN, MAY_FIRE = 1, 2, 4
# Entries of FabricState.total.
(
    EVENTS, LOST, SPURIOUS, IDEAL, CHARGE_TOTAL, PROGRAM_ENERGY, READ_ENERGY, SPIKES, STEPS_DONE, BUSY, WORST_BUSY,
    DISABLED_EVENTS, HALF_ROW, HALF_COLUMN, HALF_BOTH,
) = range(15)  # fmt: skip
TOTALS = 15
WORD = 62  # neurons whose bits one signed number holds
# Entries of FabricState.clock: the step, solves that did not converge, whether anything is programmed in this step.
STEP, FAILED, BUSY_LINES = 0, 1, 2


# What is read together lies together: one record a cell, tile, neuron. Kernels take few arrays, since numba copies
# every array's description on every call.
CELL_FIELDS = np.dtype([
    # Indices are unsigned, so that none is asked whether it counts from the end; of 32 bits, since numba takes 64
    # unsigned and 64 signed bits together for a float.
    ("sender", "u4"), ("receiver", "u4"), ("tile", "u4"),
    ("line", "u4"),  # of `FabricState.busy`
    ("row", "i8"),  # physical word line, counted so that all tiles end at the senses
    ("column", "i8"),  # physical bit line
    ("tap", "i8"),
    ("late", "u8"),  # how far behind the step's own slot of the ring its spike lies
    ("number", "i8"),  # of the synapse, or beyond them of a disabled cell: counter of the noise
    ("is_synapse", "?"),
    ("is_live", "?"),  # whether events move it
    ("polarity", "f8"),  # of the read voltage times that of the bit line
    ("first_s", "f8"),
    ("first_origin", "f8"),  # in the coordinate of the tile's family
    ("first_belief", "f8"),  # what an exact-width driver takes the state for
    ("fixed_g", "f8"),  # [S] of a cell that is not live
    ("factor", "f8"),  # charge or flux of its events, 1 nominally
    ("threshold", "f8"),  # [V]
    ("series", "f8"),  # [ohm] of the wires to it when it is selected
])  # fmt: skip
CELL_STATE = np.dtype([
    ("s", "f8"),
    ("origin", "f8"),  # coordinate from which events are counted
    ("count", "f8"),  # events since
    ("belief_origin", "f8"), ("belief_count", "f8"),  # what an exact-width driver takes for true
    ("g", "f8"),  # [S]
    ("load", "f8"),  # [S] that a read drives, reference included
    ("weight", "f8"),  # as read, with its polarity and its tile's gain
    ("pulses", "i8"),
])  # fmt: skip
TILE_FIELDS = np.dtype([
    ("law", "i8"),
    ("family", "i8"),  # of its cells' coordinate; INTEGRATED, or negative if no event moves them
    ("charge_scale", "f8"),  # q_d [C]
    ("event_charge", "f8"),  # [C] of one event
    ("reference", "f8"),  # [S] that is subtracted
    ("g_on", "f8"),  # [S]
    ("gain", "f8"),  # 1 nominally
    ("event_flux", "f8"),  # [Wb] of one pulse of fixed voltage
    ("duration", "f8"),  # [s] of one pulse of fixed duration
    ("bottom", "f8"), ("top", "f8"),  # coordinates of s = 0 and s = 1
    # Of the law; inside the record, since an array of its own would be reference-counted at every use.
    ("parameters", "f8", (max(len(law.parameters) for law in LAWS.values()),)),
])  # fmt: skip
# What a column reads through wires: every word line that has a neuron, whether a device stands there or not.
READ_FIELDS = np.dtype([
    ("sender", "u4"), ("tap", "i8"), ("late", "u8"), ("tile", "u4"), ("row", "i8"), ("column", "i8"),
    ("polarity", "f8"),
])  # fmt: skip
READ_STATE = np.dtype([("load", "f8"), ("weight", "f8")])  # as of a cell
NEURON_FIELDS = np.dtype([
    ("a", "f8"), ("b", "f8"), ("y_thresh", "f8"), ("offset", "f8"),
    ("full_scale", "f8"),  # rows that a converter must hold
])  # fmt: skip
NEURON_STATE = np.dtype([
    ("y", "f8"),
    ("ls", "u4"),  # scratch where all lines are driven
])  # fmt: skip
CONSTANT_FIELDS = np.dtype([
    # drive
    ("mode", "i8"), ("parallelism", "i8"), ("event_level", "f8"), ("pulse_voltage", "f8"),
    ("counts_half_selects", "?"),
    # effects
    ("asymmetry", "f8"), ("metering_delay", "f8"), ("cycle_to_cycle", "f8"), ("cycle_key", "u8"),
    ("half_select", "f8"), ("read_disturb", "f8"), ("read_noise", "f8"), ("read_key", "u8"), ("bits", "i8"),
    ("settled", "f8"),  # fraction of its output that a column reaches within the read
    ("decay", "f8"),  # of the state in one timestep
    # periphery and neurons
    ("read_voltage", "f8"), ("read_duration", "f8"), ("last_spike", "i8"), ("c", "f8"), ("c_ini", "f8"),
    ("synapse_gain", "f8"), ("high_count", "i8"), ("clamp", "?"), ("carry", "?"),
])  # fmt: skip
ROW, COLUMN_LINE = 0, 1  # of `levels`


class Fabric(NamedTuple):
    """One die, read only."""

    cells: npt.NDArray[np.void]  # (cell,)
    starts: Indices  # (receiver + 1,) cells of each receiver
    reads: npt.NDArray[np.void]  # (read,) what columns read: the cells themselves, or READ_FIELDS through wires
    read_starts: Indices  # (receiver + 1,)
    tiles: npt.NDArray[np.void]  # (tile,)
    neurons: npt.NDArray[np.void]  # (neuron,)
    constants: npt.NDArray[np.void]  # (1,)
    table: npt.NDArray[np.int8]  # (ls_pre, ls_post) WANTED_UP | WANTED_DOWN | MAY_FIRE
    asking: Indices  # (pair, [ls_pre, ls_post]) where `table` is not 0
    pairs: Indices  # (receiver * neurons + sender + 1,) cells of each pair
    programmed: IntArray  # (receiver, word) senders of its cells in tiles that events move, as bits
    phase: FloatArray  # (phase,) duration in pulses
    seen: FloatArray  # (phase, ls_pre, ls_post, [row, column, size of the difference in pulse voltages])
    levels: FloatArray  # (phase, ROW or COLUMN_LINE, ls) in units of the waveform
    # Their types say what is compiled.
    wires: Any  # NoWires or Wires
    pulses: Any  # ClosedPulses or AnyPulses
    lines: Any  # SelectedCells or DrivenLines
    rest: Any  # Lasting or Passing


class NoWires(NamedTuple):
    """Every device sees exactly the voltage of its lines."""

    unused: int = 0


class ClosedPulses(NamedTuple):
    """Every plastic law moves in a closed form."""

    unused: int = 0


class AnyPulses(NamedTuple):
    """Some law is integrated."""

    unused: int = 0


class Lasting(NamedTuple):
    """Nothing but programming moves a state."""

    unused: int = 0


class Passing(NamedTuple):
    """States decay, or are disturbed by reads."""

    unused: int = 0


class SelectedCells(NamedTuple):
    """Cells are programmed one by one, or see exactly the voltage of their lines."""

    unused: int = 0


class DrivenLines(NamedTuple):
    """All lines are driven at once, through their wires."""

    unused: int = 0


class Wires(NamedTuple):
    """Lines of all tiles, padded to the largest; what is padded carries no current."""

    r_row: float
    r_column: float
    near: FloatArray  # (row,) conductance of a driver and the first segment [S]; infinite is ideal
    far: FloatArray  # (column,) of the last segment and a sense
    open_row: FloatArray  # (row,) zeros
    open_column: FloatArray
    row_neuron: IntArray  # (tile, row) or -1
    column_neuron: IntArray  # (tile, column) or -1
    reference_column: IntArray  # (tile,) or -1
    still: FloatArray  # (tile, row, column) conductances that are no cell's [S]
    first_cell: IntArray  # (tile + 1,) into `of_tile`
    of_tile: IntArray  # (cell,) cells sorted by tile


class LineState(NamedTuple):
    """Potentials and conductances by line."""

    grid: FloatArray  # (tile, row, column) [S]
    middle: FloatArray  # (row, column) [S] in the middle of a pulse
    transfer: FloatArray  # (tile, row, column) current into a column per volt on a row [S]
    u: FloatArray  # (tile, column, row, column) potentials of the rows, for the next guess
    w: FloatArray  # (row, column)
    u_program: FloatArray  # (tile, phase, row, column)
    work: FloatArray  # scratch of the solver
    source: FloatArray  # (row, column) zeros
    v_row: FloatArray  # (row,)
    v_column: FloatArray  # (column,)
    fired: IntArray  # (phase, cell) 1, -1 or 0


class FabricState(NamedTuple):
    """What changes while a die runs."""

    cells: npt.NDArray[np.void]  # (cell,)
    reads: npt.NDArray[np.void]  # (read,) the cells themselves, or READ_STATE
    neurons: npt.NDArray[np.void]  # (neuron,)
    ring: FloatArray  # (slot, neuron) 1 for a spike: shift registers of the rows; both are powers of two
    clock: IntArray  # [STEP, FAILED, BUSY_LINES]
    busy: FloatArray  # (line, sign) programming time of this step [s], of each tile or, side by side, bit line
    total: FloatArray  # (TOTALS,)
    is_stale: BoolArray  # (tile,) whether what columns read through wires is of other conductances
    by_ls: IntArray  # (ls, word) neurons of an ls, as bits, before it decays at the end of the step
    lines: Any  # NoWires or LineState


def power_of_two(least: int) -> int:
    """The next one."""
    return 1 << max(least - 1, 0).bit_length()


def words_of(neurons: int) -> int:
    """Numbers that hold a bit for each neuron."""
    return -(-neurons // WORD)


def as_bits(chosen: Any) -> IntArray:
    """(neuron,) as bits, (word,)."""
    padded = np.zeros(words_of(len(chosen)) * WORD, dtype=np.int64)
    padded[: len(chosen)] = chosen
    bits: IntArray = (padded.reshape(-1, WORD) << np.arange(WORD)).sum(axis=1)
    return bits


def lateness(tap: Any, sender: Any, neurons: int) -> Any:
    """Of spikes in a ring laid out flat: steps times its width, less the sender's place."""
    return (np.asarray(tap) * power_of_two(neurons) - np.asarray(sender)).astype(np.uint64)


def empty_state(f: Fabric, *, slots: int, scratch: int) -> FabricState:
    """State before the first reset."""
    n, cells, tiles, phases = len(f.neurons), len(f.cells), len(f.tiles), len(f.phase)
    lines: NoWires | LineState = NoWires()
    if isinstance(f.wires, Wires):
        m, width = f.wires.still.shape[1:]
        lines = LineState(
            grid=np.zeros((tiles, m, width)), middle=np.zeros((m, width)),
            transfer=np.zeros((tiles, m, width)), u=np.zeros((tiles, width, m, width)), w=np.zeros((m, width)),
            u_program=np.zeros((tiles, phases, m, width)), work=np.zeros((scratch, m, width)),
            source=np.zeros((m, width)), v_row=np.zeros(m), v_column=np.zeros(width),
            fired=np.zeros((phases, cells), dtype=np.int64),
        )  # fmt: skip
    state = np.zeros(cells, dtype=CELL_STATE)
    reads = np.zeros(len(f.reads), dtype=READ_STATE) if isinstance(f.wires, Wires) else state
    return FabricState(
        cells=state, reads=reads, neurons=np.zeros(n, dtype=NEURON_STATE),
        ring=np.zeros((power_of_two(slots), power_of_two(n))), clock=np.zeros(3, dtype=np.int64),
        busy=np.zeros((max(int(f.cells["line"].max(initial=0)) + 1, tiles), 2)), total=np.zeros(TOTALS),
        is_stale=np.ones(tiles, dtype=np.bool_), lines=lines,
        by_ls=np.zeros((f.table.shape[0], words_of(n)), dtype=np.int64),
    )  # fmt: skip
