"""Single shooting: from coordinates to the current at every sample, with exact derivatives.

The state is advanced by the exponential Rosenbrock-Euler rule, ``s += h phi1(h J) f`` with ``J = df/ds`` and
``phi1(z) = (e^z - 1)/z`` (M. Hochbruck, A. Ostermann, Acta Numerica 19 (2010) 209, eq. 2.36), with the voltage at
the middle of each substep: A-stable, second order, exact for a linear relaxation. Walls are `clip`. Its derivatives
in all coordinates are carried along, as CasADi derives them from the law.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom.devices.fitting._coordinates import Coordinates
from ohmloom.devices.fitting._interrupt import raise_pending
from ohmloom.devices.laws import LAWS
from ohmloom.devices.measurement import Measurement

# Rounds of Newton's rule for the device's voltage behind a series resistor, where G depends on it.
VOLTAGE_ROUNDS = 6
LARGEST_GROWTH = 20.0
# An unstable state may multiply its derivatives without end; squares of these still are numbers.
LARGEST_SLOPE = 1e100


class Shooting:
    """The residual of a law against sweeps: ``(i_model - i) / size`` at each sample, and its Jacobian.

    Coordinates are those of `Coordinates`, followed by one start state per sweep. Sizes are such that the squares of
    all residuals sum to the mean over the sweeps of the squared relative RMS, where weights are "relative".
    """

    def __init__(self, coordinates: Coordinates, sweeps: tuple[Measurement, ...], sizes: tuple[FloatArray, ...],
                 *, substeps: int, follow: bool = False) -> None:  # fmt: skip
        """`follow`: let the measured current and voltage, not the model's own, move the state (charge regression)."""
        self.coordinates, self.sweeps, self.sizes = coordinates, sweeps, sizes
        self.parameters, self.substeps = len(coordinates.free), substeps
        has_series = any(sweep.series_resistance > 0 for sweep in sweeps)
        held = tuple(sorted(coordinates.held.items()))
        self._steppers = [
            _stepper(coordinates.law.name, coordinates.names, held, has_series, follow, substeps, len(sweep.t))
            for sweep in sweeps
        ]
        self._inputs = [_inputs(sweep) for sweep in sweeps]

    @property
    def follows_current(self) -> bool:
        """Whether the law's state is moved by the current, so that a measured one can move it instead."""
        import casadi as ca

        law = self.coordinates.law
        i, p = ca.SX.sym("i"), [parameter.default for parameter in law.parameters]
        return bool(ca.depends_on(ca.SX(law.charge_rate(ca.SX.sym("s"), ca.SX.sym("v"), i, p)), i))

    def residual(self, z: FloatArray) -> FloatArray:
        """Axes (sample of all sweeps,)."""
        return np.concatenate([
            (self.current(z, k) - sweep.i) / size
            for k, (sweep, size) in enumerate(zip(self.sweeps, self.sizes, strict=True))
        ])  # fmt: skip

    def jacobian(self, z: FloatArray) -> FloatArray:
        """Axes (sample of all sweeps, coordinate)."""
        n, blocks = self.parameters, []
        for k, size in enumerate(self.sizes):
            slopes = self._run(z, k, with_slopes=True)[1]
            block = np.zeros((len(size), len(z)))
            block[:, :n] = slopes[:, :n]
            block[:, n + k] = slopes[:, n]
            blocks.append(block / size[:, None])
        with np.errstate(invalid="ignore"):
            whole = np.concatenate(blocks)
            return np.clip(np.nan_to_num(whole), -LARGEST_SLOPE, LARGEST_SLOPE)

    def current(self, z: FloatArray, sweep: int) -> FloatArray:
        """The model's current [A] in one sweep, axes (time,)."""
        return self._run(z, sweep, with_slopes=False)[0]

    def state(self, z: FloatArray, sweep: int) -> FloatArray:
        """The model's state in one sweep, axes (time,)."""
        return self._run(z, sweep, with_slopes=False)[1]

    def _run(self, z: FloatArray, k: int, *, with_slopes: bool) -> tuple[FloatArray, FloatArray]:
        raise_pending()
        n, s0 = self.parameters, z[self.parameters + k]
        plain, sloped = self._steppers[k]
        if not with_slopes:
            states, current = plain(s0, z[:n], self._inputs[k])
            return np.array(current).ravel(), np.array(states).ravel()
        start = np.concatenate([[s0], np.zeros(n), [1.0]])
        _, current, slopes = sloped(start, z[:n], self._inputs[k])
        return np.array(current).ravel(), np.array(slopes).T


def _inputs(sweep: Measurement) -> FloatArray:
    """Per sample, axes (input, time): voltage before and now, gap in s, series resistance, the same two of the device.

    The first gap is of length zero, so that every sample is the end of a step.
    """

    def before(x: FloatArray) -> FloatArray:
        return np.concatenate([x[:1], x[:-1]])

    v, resistance = sweep.v, np.full(len(sweep.t), sweep.series_resistance)
    device, gaps = sweep.device_voltage, sweep.t - before(sweep.t)
    return np.stack([before(v), v, gaps, resistance, before(device), device, before(sweep.i), sweep.i])


@lru_cache(maxsize=64)
def _stepper(law: str, names: tuple[str, ...], held: tuple[tuple[str, float], ...], has_series: bool, follow: bool,
             substeps: int, samples: int) -> tuple[Any, Any]:  # fmt: skip
    """CasADi functions over a whole sweep: without and with derivatives."""
    plain, sloped = _one_step(law, names, held, has_series, follow, substeps)
    return plain.mapaccum(samples), sloped.mapaccum(samples)


@lru_cache(maxsize=64)
def _one_step(law_name: str, names: tuple[str, ...], held: tuple[tuple[str, float], ...], has_series: bool,
              follow: bool, substeps: int) -> tuple[Any, Any]:  # fmt: skip
    import casadi as ca

    law = LAWS[law_name]
    coordinates = Coordinates(law=law, free=tuple(p for p in law.parameters if p.name in names), held=dict(held))
    n = len(names)
    z, s, u = ca.SX.sym("z", n), ca.SX.sym("s"), ca.SX.sym("u", 8)
    p = list(coordinates.values(z, exp=ca.exp).values())
    q_d = law.charge_scale(p)
    # The state equation, once, in symbols of its own: its derivative in s is taken before substeps are composed.
    x, v_in, v_measured, i_measured = (ca.SX.sym(name) for name in ("x", "v_in", "v_measured", "i_measured"))
    v = _device_voltage(law, x, v_in, u[3], p, z) if has_series else v_in
    if follow:
        slope = law.charge_rate(x, v_measured, i_measured, p) / q_d
    else:
        slope = law.charge_rate(x, v, law.conductance(x, v, p) * v, p) / q_d
    field = ca.Function("field", [x, v_in, v_measured, i_measured, z, u], [slope, ca.gradient(slope, x)])
    output = ca.Function("output", [x, v_in, z, u], [law.conductance(x, v, p) * v])

    h, state = u[2] / substeps, s
    for k in range(substeps):
        part = (k + 0.5) / substeps
        rate, stiffness = field(state, *(u[a] + part * (u[a + 1] - u[a]) for a in (0, 4, 6)), z, u)
        growth = ca.fmin(h * stiffness, LARGEST_GROWTH)
        is_small = ca.fabs(growth) < 1e-5
        safe = growth + is_small
        phi = is_small * (1.0 + 0.5 * growth) + (1 - is_small) * ca.expm1(safe) / safe
        clipped = ca.fmin(ca.fmax(state + h * phi * rate, 0.0), 1.0)
        # The derivative is zero at the wall itself, where it would grow without end while a state is trapped.
        state = (clipped > 0.0) * (clipped < 1.0) * clipped + (clipped >= 1.0)
    current = output(state, u[1], z, u)
    plain = ca.Function("plain", [s, z, u], [state, current])

    # The first entry is the state, then its derivatives in each parameter's coordinate and in the start state.
    sensitivity = ca.SX.sym("ds", n + 1)
    ahead = ca.jacobian(state, s) * sensitivity + ca.vertcat(ca.jacobian(state, z).T, 0)
    at_end = ca.Function("at_end", [s, z, u], [output(s, u[1], z, u)])
    end = ca.SX.sym("end")
    out = at_end(end, z, u)
    make = ca.Function("slopes", [end, z, u], [ca.gradient(out, end), ca.jacobian(out, z).T])
    by_state, by_parameters = make(state, z, u)
    slopes = by_state * ahead + ca.vertcat(by_parameters, 0)
    sloped = ca.Function("sloped", [ca.vertcat(s, sensitivity), z, u], [ca.vertcat(state, ahead), current, slopes])
    return plain, sloped


def _device_voltage(law: Any, s: Any, v_source: Any, resistance: Any, p: Any, z: Any) -> Any:
    """Voltage of the device behind a series resistor: in closed form if G does not depend on v, else by Newton's rule.

    In logarithms, for the share of the source's voltage: where the current grows exponentially, the rule on the
    voltage itself would come closer by a fixed amount each round only. The start is above the root.
    """
    import casadi as ca

    v = ca.SX.sym("v")
    g = law.conductance(s, v, p)
    if not ca.depends_on(g, v):
        return v_source / (1.0 + resistance * g)
    share = ca.SX.sym("share")
    whole = 1.0 + resistance * g
    step = ca.Function("step", [v, share, s, resistance, z], [
        share * ca.exp(-ca.log(share * whole) / (1.0 + v * ca.gradient(whole, v) / whole))
    ])  # fmt: skip
    found = 1.0 / (1.0 + resistance * law.conductance(s, 0.0, p))
    for _ in range(VOLTAGE_ROUNDS):
        found = step(v_source * found, found, s, resistance, z)
    return v_source * found
