"""Charge-revisit test: before any fit, does the conductance of a measured device follow its charge?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom.devices.measurement import Measurement
from ohmloom.errors import expect_type

# Below this share of the largest voltage, offset and noise decide what i/v is.
SMALLEST_VOLTAGE = 0.1
# Bins of equal numbers of points, so that a bin is narrow where the device spends its time.
BINS = 20
POINTS_PER_BIN = 5
FEWEST_BINS = 5
# With less than this share of the points visited twice, a small number would say nothing.
SMALLEST_SHARE = 0.4
ONE_WAY = 0.9  # net charge over throughput beyond which charge is hardly ever visited twice
SMALLEST_CHANGE = 0.02  # standard deviation of log G; below it, noise of a per cent would decide
# Upper ends of "follows", "mostly follows" and "follows in part", in unexplained variance.
FOLLOWS, MOSTLY, PARTLY = 0.05, 0.2, 0.5


@dataclass(frozen=True, kw_only=True)
class Revisit:
    """What the charge-revisit test found.

    Attributes
    ----------
    net_over_throughput
        Net charge over all the charge that moved, ``|integral of i dt| / integral of |i| dt``, in [0, 1].
    unexplained_by_charge, unexplained_by_flux
        Variance of the logarithm of the chord conductance i/v within bins of equal charge (flux) that were visited in
        passes of both directions, over its variance in the whole sweep, in [0, 1]. 0: one conductance for each charge.
        None: the sweep does not test it.
    verdict
        The same in words.
    """

    net_over_throughput: float
    unexplained_by_charge: float | None
    unexplained_by_flux: float | None
    verdict: str


def charge_revisit(measurement: Measurement) -> Revisit:
    """Test whether points that share a charge, visited in different passes, share a conductance.

    In a charge-driven device the conductance is a function of the charge that went through it, so whenever the sweep
    returns to a charge it returns to a conductance. The same with the flux is given for comparison; an ideal memristor
    passes both. Only points above a tenth of the largest device voltage count; a pass ends where the voltage changes
    sign, and points are compared in 20 bins of equal size.

    The test sees neither a static nonlinearity under one symmetric sweep, where every charge is met at the same
    voltage on both ways, nor a charge-driven state that rested at its limit while charge went on to flow: there it
    reports a law that is not charge-driven.

    Raises
    ------
    ParameterError
        If `measurement` is no `Measurement`.

    Examples
    --------
    >>> import numpy as np
    >>> from ohmloom.devices import Device
    >>> t = np.linspace(0.0, 1.0, 401)
    >>> loop = Device.load("hp_tio2").simulate(np.sin(2 * np.pi * t), t, s0=0.3)
    >>> found = charge_revisit(Measurement(name="ideal", t=loop.t, v=loop.v, i=loop.i))
    >>> found.unexplained_by_charge < 0.01
    True
    """
    expect_type("charge_revisit.measurement", measurement, Measurement)
    v, i = measurement.device_voltage, measurement.i
    charge = measurement.charge
    # Of scaled numbers: the charge of very small currents or times would vanish.
    share, t = i / np.abs(i).max(), (measurement.t - measurement.t[0]) / measurement.duration
    net = abs(float(np.trapezoid(share, t))) / float(np.trapezoid(np.abs(share), t))
    large = np.abs(v) > SMALLEST_VOLTAGE * np.abs(v).max()
    # An offset may turn the current against the voltage; such a point has no logarithm.
    used = np.flatnonzero(large & (np.sign(i) * np.sign(v) > 0))
    # A difference of logarithms: the quotient of very small numbers might overflow.
    log_g = np.log(np.abs(i[used])) - np.log(np.abs(v[used]))
    passes = np.cumsum(np.diff(np.sign(v[used]), prepend=0.0) != 0)
    change = float(log_g.std()) if used.size else 0.0
    by_charge = by_flux = None
    if change >= SMALLEST_CHANGE:
        by_charge = _unexplained(log_g, charge[used], passes) if net <= ONE_WAY else None
        by_flux = _unexplained(log_g, measurement.flux[used], passes)
    return Revisit(
        net_over_throughput=net,
        unexplained_by_charge=by_charge,
        unexplained_by_flux=by_flux,
        verdict=_verdict(net, by_charge, by_flux, change),
    )


def _unexplained(log_g: FloatArray, coordinate: FloatArray, passes: FloatArray) -> float | None:
    """Variance of `log_g` at equal `coordinate` in different passes, over all of it; None if too little is shared."""
    size = log_g.size
    bins = min(BINS, size // POINTS_PER_BIN)
    if bins < FEWEST_BINS:
        return None
    members = np.array_split(np.argsort(coordinate, kind="stable"), bins)
    shared = [k for k in members if np.unique(passes[k]).size > 1]
    if sum(k.size for k in shared) < SMALLEST_SHARE * size:
        return None
    within = sum(k.size * float(log_g[k].var()) for k in shared)
    return min(within / (size * float(log_g.var())), 1.0)


def _verdict(net: float, by_charge: float | None, by_flux: float | None, change: float) -> str:
    if change < SMALLEST_CHANGE:
        return (
            f"The conductance hardly changes in this sweep (by {100 * change:.2g} %), so what it depends on cannot be "
            "tested. Sweep further or slower."
        )
    if by_charge is None and net > ONE_WAY:
        return (
            f"This sweep cannot tell whether the conductance follows the charge: the current flows one way (net charge "
            f"{100 * net:.3g} % of all that moved), so hardly any charge is visited twice, and a charge-driven law can "
            "look right without being so. Add a sweep of both polarities."
        )
    if by_charge is None:
        return (
            "This sweep cannot tell whether the conductance follows the charge: too few points share a charge between "
            "passes of both directions. Add a sweep of both polarities, or take more points per period."
        )
    other = "" if by_flux is None else f" (at equal flux {100 * by_flux:.2g} %)"
    found = (
        f"points at equal charge in different passes leave {100 * by_charge:.2g} % of the variance of log conductance "
        f"unexplained{other}."
    )
    if by_charge <= FOLLOWS:
        return f"The conductance follows the charge: {found} A charge-driven law such as hp_linear may fit."
    rest = "Compare laws with thresholds or a redox reaction, and check whether the state reached a limit."
    if by_charge <= MOSTLY:
        return f"The conductance mostly follows the charge: {found} {rest}"
    if by_charge <= PARTLY:
        return f"The conductance follows the charge only in part: {found} {rest}"
    return f"The conductance does not follow the charge: {found} {rest}"
