"""Compiled discrete controller: bit masks with the default rule, of one word up to 62 neurons; else a general form.

All equal ``plain`` spike for spike. Sums run in ascending order of the presynaptic neuron, from 0.0.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ohmloom._arrays import FloatArray, IntArray
from ohmloom._jit import copy_flat, inlined_kernel, kernel, lowest_bit

INPUTS = 6
STEPS = 21
BITS = 62  # neurons in one word of a mask; the sign bit stays free
FORWARD, LEFT, RIGHT = 0, 1, 2


class Wiring(NamedTuple):
    """One network, read only. Masks hold presynaptic neurons as bits; matrices have axes (post, pre)."""

    neurons: int
    masked: bool  # whether the form with masks of one word applies
    direct: np.ndarray  # (post,) delay of one step
    descending: np.ndarray  # (post,) from higher hidden neurons, delay i_s - i_r
    ascending: np.ndarray  # (post,) from lower hidden neurons, delay i_r - i_s
    plastic: np.ndarray  # (post,)
    words: np.ndarray  # (the four above, post, word) for the form with more words; none where it does not apply
    sign: np.ndarray  # (pre,)
    kind: np.ndarray  # (post, pre) row of `tables`
    first_weight: np.ndarray  # (post, pre), with the sender's sign
    first_level: np.ndarray  # (post, pre)
    starts: np.ndarray  # (post + 1,) the general form: synapses sorted by post, then pre
    senders: np.ndarray  # (synapse,)
    delays: np.ndarray  # (synapse,)
    tables: np.ndarray  # (kind, level) weight
    up: np.ndarray  # (kind, level) level after a positive event
    down: np.ndarray  # (kind, level)
    a: float
    b: float
    c: float
    c_ini: float
    y_thresh: float
    gain: float
    last_spike: int
    stdp_threshold: int
    high_count: int
    at_emission: bool
    input_bias: bool
    clamp: bool
    carry: bool


class ControllerState(NamedTuple):
    """What changes while a network runs."""

    y: np.ndarray  # (neuron,)
    weight: np.ndarray  # (post, pre), with the sender's sign
    level: np.ndarray  # (post, pre)
    masks: np.ndarray  # [spikes of the last step]
    waves: np.ndarray  # (2, neuron) descending and ascending senders whose spike arrives now
    word_masks: np.ndarray  # (3, word) spikes of the last step; of this step; of the last and not of this
    word_waves: np.ndarray  # (2, neuron, word) as `waves`
    ls: np.ndarray  # (neuron,) the general form
    ring: np.ndarray  # (slot, neuron) spikes of past steps
    emitted: np.ndarray  # (slot, synapse) weights at emission
    clock: np.ndarray  # [step]
    events: np.ndarray  # [positive, negative]


@kernel
def membrane(y: float, current: float, bias: float, b: float, clamp: bool) -> float:
    """Eq. 3."""
    y = y + (current + bias - b * y)
    if clamp and y < 0.0:
        y = 0.0
    return y


@kernel
def classify(left: int, right: int, high_count: int) -> int:
    """Eq. 6 and Section VIII-A."""
    first_high, second_high = left >= high_count, right >= high_count
    if first_high == second_high:
        return FORWARD
    return LEFT if first_high else RIGHT


@kernel
def reset_activity(w: Wiring, s: ControllerState) -> None:
    s.y[:] = w.c_ini
    s.masks[:] = 0
    s.waves[:] = 0
    s.word_masks[:] = 0
    s.word_waves[:] = 0
    s.ls[:] = 0
    s.ring[:] = False
    s.clock[0] = 0


@kernel
def reset(w: Wiring, s: ControllerState) -> None:
    reset_activity(w, s)
    copy_flat(s.weight, w.first_weight)
    copy_flat(s.level, w.first_level)
    s.events[:] = 0


@kernel
def _move(
    sign: FloatArray, kind: np.ndarray, tables: FloatArray, up: np.ndarray, down: np.ndarray,
    weight: FloatArray, level: np.ndarray, events: IntArray, post: int, pre: int, positive: bool,
) -> None:  # fmt: skip
    row = kind[post, pre]
    now = level[post, pre]
    now = up[row, now] if positive else down[row, now]
    level[post, pre] = now
    weight[post, pre] = sign[pre] * tables[row, now]
    events[0 if positive else 1] += 1


@kernel
def stdp_masked(
    plastic: IntArray, sign: FloatArray, kind: np.ndarray, tables: FloatArray, up: np.ndarray,
    down: np.ndarray, weight: FloatArray, level: np.ndarray, events: IntArray, new: int, old: int,
) -> None:  # fmt: skip
    """Eqs. 10 and 11: ls = 3 for `new` spikes, 2 for `old` ones; only these pairs exceed 4 unequally."""
    posts = new
    while posts != 0:
        post = lowest_bit(posts)
        posts &= posts - 1
        pres = plastic[post] & old
        while pres != 0:
            _move(sign, kind, tables, up, down, weight, level, events, post, lowest_bit(pres), True)
            pres &= pres - 1
    posts = old
    while posts != 0:
        post = lowest_bit(posts)
        posts &= posts - 1
        pres = plastic[post] & new
        while pres != 0:
            _move(sign, kind, tables, up, down, weight, level, events, post, lowest_bit(pres), False)
            pres &= pres - 1


@inlined_kernel
def _run_masked(w: Wiring, s: ControllerState, sensors: FloatArray, spiked: IntArray, steps: int) -> None:
    # Fields are taken out once: reading them from the tuple in the loop would count references every time.
    direct, descending, ascending, plastic = w.direct, w.descending, w.ascending, w.plastic
    sign, kind, tables, up, down = w.sign, w.kind, w.tables, w.up, w.down
    y_all, weight, level, waves, events = s.y, s.weight, s.level, s.waves, s.events
    neurons, a, b, c, y_thresh, gain, clamp = w.neurons, w.a, w.b, w.c, w.y_thresh, w.gain, w.clamp
    input_bias = a if w.input_bias else 0.0
    first_output = neurons - 2
    last = s.masks[0]
    for _ in range(steps):
        spikes = 0
        for j in range(neurons):
            if j < INPUTS:
                y = membrane(y_all[j], sensors[j], input_bias, b, clamp)
            else:
                arriving = (direct[j] & last) | (descending[j] & waves[0, j]) | (ascending[j] & waves[1, j])
                total = 0.0
                while arriving != 0:
                    total += weight[j, lowest_bit(arriving)]
                    arriving &= arriving - 1
                y = membrane(y_all[j], gain * total, a, b, clamp)
            if y > y_thresh:
                y = c
                spikes |= 1 << j
                spiked[j] += 1
            y_all[j] = y
        # A spike travels one neuron per step: each wave is the neighbour's last wave plus its spike.
        for j in range(INPUTS, first_output - 1):
            waves[0, j] = waves[0, j + 1] | (spikes & (1 << (j + 1)))
        for j in range(first_output - 1, INPUTS, -1):
            waves[1, j] = waves[1, j - 1] | (spikes & (1 << (j - 1)))
        stdp_masked(plastic, sign, kind, tables, up, down, weight, level, events, spikes, last & ~spikes)
        last = spikes
    s.masks[0] = last


@kernel
def _stdp_words(
    plastic: IntArray, sign: FloatArray, kind: np.ndarray, tables: FloatArray, up: np.ndarray, down: np.ndarray,
    weight: FloatArray, level: np.ndarray, events: IntArray, posts: IntArray, senders: IntArray, positive: bool,
) -> None:  # fmt: skip
    """`stdp_masked` in one direction."""
    words = len(posts)
    for i in range(words):
        left = posts[i]
        while left != 0:
            post = BITS * i + lowest_bit(left)
            left &= left - 1
            for k in range(words):
                pres = plastic[post, k] & senders[k]
                while pres != 0:
                    pre = BITS * k + lowest_bit(pres)
                    pres &= pres - 1
                    _move(sign, kind, tables, up, down, weight, level, events, post, pre, positive)


@kernel
def _run_words(w: Wiring, s: ControllerState, sensors: FloatArray, spiked: IntArray, steps: int) -> None:
    direct, descending, ascending, plastic = w.words[0], w.words[1], w.words[2], w.words[3]
    sign, kind, tables, up, down = w.sign, w.kind, w.tables, w.up, w.down
    y_all, weight, level, events, falling, rising = s.y, s.weight, s.level, s.events, s.word_waves[0], s.word_waves[1]
    last, new, old = s.word_masks[0], s.word_masks[1], s.word_masks[2]
    neurons, a, b, c, y_thresh, gain, clamp = w.neurons, w.a, w.b, w.c, w.y_thresh, w.gain, w.clamp
    input_bias = a if w.input_bias else 0.0
    words, first_output = len(last), neurons - 2
    for _ in range(steps):
        new[:] = 0
        for j in range(neurons):
            if j < INPUTS:
                y = membrane(y_all[j], sensors[j], input_bias, b, clamp)
            else:
                total = 0.0
                for k in range(words):
                    arriving = (direct[j, k] & last[k]) | (descending[j, k] & falling[j, k])
                    arriving |= ascending[j, k] & rising[j, k]
                    while arriving != 0:
                        total += weight[j, BITS * k + lowest_bit(arriving)]
                        arriving &= arriving - 1
                y = membrane(y_all[j], gain * total, a, b, clamp)
            if y > y_thresh:
                y = c
                new[j // BITS] |= 1 << (j % BITS)
                spiked[j] += 1
            y_all[j] = y
        for j in range(INPUTS, first_output - 1):
            for k in range(words):
                falling[j, k] = falling[j + 1, k]
            falling[j, (j + 1) // BITS] |= new[(j + 1) // BITS] & (1 << ((j + 1) % BITS))
        for j in range(first_output - 1, INPUTS, -1):
            for k in range(words):
                rising[j, k] = rising[j - 1, k]
            rising[j, (j - 1) // BITS] |= new[(j - 1) // BITS] & (1 << ((j - 1) % BITS))
        for k in range(words):
            old[k] = last[k] & ~new[k]
            last[k] = new[k]
        _stdp_words(plastic, sign, kind, tables, up, down, weight, level, events, new, old, True)
        _stdp_words(plastic, sign, kind, tables, up, down, weight, level, events, old, new, False)


@kernel
def stdp_general(w: Wiring, s: ControllerState) -> None:
    """Eqs. 10 and 11 for any last_spike and threshold, then the decay of ls."""
    starts, senders, sign, kind, tables, up, down = w.starts, w.senders, w.sign, w.kind, w.tables, w.up, w.down
    weight, level, events, ls = s.weight, s.level, s.events, s.ls
    threshold, kinds = w.stdp_threshold, w.tables.shape[0]
    for post in range(INPUTS, w.neurons):
        ls_post = ls[post]
        for k in range(starts[post], starts[post + 1]):
            pre = senders[k]
            ls_pre = ls[pre]
            if ls_pre + ls_post > threshold and ls_pre != ls_post and kind[post, pre] < kinds:
                _move(sign, kind, tables, up, down, weight, level, events, post, pre, ls_post > ls_pre)
    for j in range(w.neurons):
        if ls[j] > 0:
            ls[j] -= 1


@kernel
def _step_general(w: Wiring, s: ControllerState, sensors: FloatArray, spiked: IntArray) -> None:
    starts, senders, delays = w.starts, w.senders, w.delays
    y_all, weight, ring, emitted, ls = s.y, s.weight, s.ring, s.emitted, s.ls
    a, b, y_thresh, clamp, at_emission = w.a, w.b, w.y_thresh, w.clamp, w.at_emission
    slots = ring.shape[0]
    now = s.clock[0]
    slot = now % slots
    for j in range(w.neurons):
        if j < INPUTS:
            y = membrane(y_all[j], sensors[j], a if w.input_bias else 0.0, b, clamp)
        else:
            total = 0.0
            for k in range(starts[j], starts[j + 1]):
                pre = senders[k]
                # No delay is longer than the ring, which is empty where nothing has been sent yet.
                sent = slot - delays[k]
                if sent < 0:
                    sent += slots
                if ring[sent, pre]:
                    total += emitted[sent, k] if at_emission else weight[j, pre]
            y = membrane(y_all[j], w.gain * total, a, b, clamp)
        above = y > y_thresh
        y_all[j] = w.c if above else y
        ring[slot, j] = above
        if above:
            ls[j] = w.last_spike
            spiked[j] += 1
    if at_emission:
        for post in range(INPUTS, w.neurons):
            for k in range(starts[post], starts[post + 1]):
                emitted[slot, k] = weight[post, senders[k]]
    stdp_general(w, s)
    s.clock[0] = now + 1


@inlined_kernel
def _advance(w: Wiring, s: ControllerState, sensors: FloatArray, spiked: IntArray, steps: int) -> None:
    if w.masked:
        _run_masked(w, s, sensors, spiked, steps)
    elif w.words.shape[2] > 0:
        _run_words(w, s, sensors, spiked, steps)
    else:
        for _ in range(steps):
            _step_general(w, s, sensors, spiked)


@kernel
def run_steps(w: Wiring, s: ControllerState, sensors: FloatArray, spiked: IntArray, steps: int) -> None:
    """`steps` steps with constant sensor values; `spiked` (neuron,) counts up with each spike."""
    _advance(w, s, sensors, spiked, steps)


@inlined_kernel
def inlined_timestep(w: Wiring, s: ControllerState, sensors: FloatArray, spiked: IntArray) -> int:
    """`timestep` for kernels."""
    if not w.carry:
        reset_activity(w, s)
    spiked[:] = 0
    _advance(w, s, sensors, spiked, STEPS)
    return classify(spiked[w.neurons - 2], spiked[w.neurons - 1], w.high_count)


@kernel
def timestep(w: Wiring, s: ControllerState, sensors: FloatArray, spiked: IntArray) -> int:
    """21 steps; `spiked` (neuron,) becomes the spike counts. Returns the action."""
    return inlined_timestep(w, s, sensors, spiked)
