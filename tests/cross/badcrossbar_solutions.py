"""Run by badcrossbar's own interpreter: solve the crossbars of one npz file, write what it finds to another."""

import sys

import numpy as np


def main(source, target):
    """Solve case by case: arrays g_k, v_k (pattern, word_line), wires_k (r_row, r_column)."""
    import badcrossbar

    given, found = np.load(source), {}
    for k in range(int(given["cases"])):
        resistances = np.where(given[f"g_{k}"] > 0.0, 1.0 / np.maximum(given[f"g_{k}"], 1e-300), np.inf)
        r_row, r_column = given[f"wires_{k}"]
        solution = badcrossbar.compute(given[f"v_{k}"].T, resistances, r_i_word_line=r_row, r_i_bit_line=r_column)
        found[f"current_{k}"] = np.atleast_2d(solution.currents.output)
        found[f"v_row_{k}"] = solution.voltages.word_line
        found[f"v_column_{k}"] = solution.voltages.bit_line
    np.savez(target, **found)


if __name__ == "__main__":
    main(*sys.argv[1:])
