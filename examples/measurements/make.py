"""Make the measurements that ohmloom ships: simulated, with noise, from laws that are not the ones to fit them with.

Run: python examples/measurements/make.py

- pickett.csv, pickett_fast.csv: HP's TiO2 by Pickett's law behind the 2.4 kOhm of its published test circuit, over 6 s
  and 0.6 s. v is the source's voltage.
- redox.csv, redox_staircase.csv: polyaniline by the redox law with the values of the card `peo_pani_redox`: a triangle
  between 0.8 V and -0.3 V, and steps of 0.1 V between 1 V and -0.2 V.

Each current has Gaussian noise of 1 % of its rms. The same files are package data (`ohmloom/devices/measurements`), so
that they are there without a clone; this script writes both.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ohmloom.devices import Device, Measurement

NOISE, SEED = 0.01, 2012
TEST_RESISTOR = 2400.0  # Ohm
FOLDERS = (Path(__file__).parent, Path(__file__).parents[2] / "ohmloom" / "devices" / "measurements")


def pickett(duration: float, points: int = 250) -> tuple[Device, np.ndarray, np.ndarray, int]:
    """The second of two periods of a sine of 1.5 V one way and 2.6 V the other.

    The test resistor stands in Pickett's own series resistance: the current through both is the same.
    """
    device = Device.load("pickett")
    device = device.replace(r_s=device.parameters["r_s"] + TEST_RESISTOR)
    t = np.arange(2 * points) * duration / points
    sine = np.sin(2 * np.pi * t / duration)
    return device, t, np.where(sine > 0.0, 1.5, 2.6) * sine, points


def triangle(points: int = 240) -> tuple[Device, np.ndarray, np.ndarray, int]:
    """0 to 0.8 to -0.3 to 0 V, 10 mV a second."""
    corners_v = np.array([0.0, 0.8, -0.3, 0.0])
    corners_t = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(corners_v)) / 0.01)])
    t = np.linspace(0.0, corners_t[-1], points)
    return Device.load("peo_pani_redox"), t, np.interp(t, corners_t, corners_v), 0


def staircase(points_per_step: int = 16, step_time: float = 30.0) -> tuple[Device, np.ndarray, np.ndarray, int]:
    """0 to 1 to -0.2 to 0 V in steps of 0.1 V, 30 s each."""
    levels = np.concatenate([np.arange(0, 11), np.arange(9, -3, -1), np.arange(-1, 1)]) / 10
    t = (np.arange(len(levels) * points_per_step) + 0.5) * step_time / points_per_step
    return Device.load("peo_pani_redox"), t, np.repeat(levels, points_per_step), 0


SWEEPS = {
    "pickett": pickett(6.0),
    "pickett_fast": pickett(0.6),
    "redox": triangle(),
    "redox_staircase": staircase(),
}


def main() -> None:
    """Write every sweep into both folders."""
    for k, (name, (device, t, v, first)) in enumerate(SWEEPS.items()):
        rng = np.random.default_rng(np.random.SeedSequence(SEED, spawn_key=(k,)))
        loop = device.simulate(v, t, s0=0.5 if device.law == "pickett" else 0.05)
        current = loop.i[first:] + NOISE * np.sqrt(np.mean(loop.i[first:] ** 2)) * rng.standard_normal(len(t) - first)
        # Six digits, as an instrument gives, so that the files are the same on every platform.
        columns = (t[first:] - t[first], v[first:], current)
        rounded = [np.array([float(f"{round(x, 12):.6g}") + 0.0 for x in column]) for column in columns]
        sweep = Measurement(name=name, t=rounded[0], v=rounded[1], i=rounded[2],
                            series_resistance=TEST_RESISTOR if device.law == "pickett" else 0.0)  # fmt: skip
        for folder in FOLDERS:
            sweep.save(folder / f"{name}.csv")
        print(f"{name}: {len(current)} points, s from {loop.s[first:].min():.3g} to {loop.s[first:].max():.3g}")


if __name__ == "__main__":
    main()
