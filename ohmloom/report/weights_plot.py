"""Weights over a trial: the discrete network's beside the hardware's."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom.report._replay_data import INK, KINDS, check_network, kind_indices

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ohmloom.neurocontroller import Network
    from ohmloom.sim import Agreement


def plot_weights(agreement: Agreement, network: Network, ax: Axes | None = None) -> Axes:
    """Draw median and quartile band of the weights of each kind over the executed timesteps.

    Solid with a filled band: the discrete network. Dashed with a dotted band: the hardware.

    Parameters
    ----------
    agreement
        Its `weights` and `emulated_weights` have axes (timestep, synapse), dimensionless.
    network
        The network that was run; tells the kind of each synapse.
    ax
        Axes to draw into; without it, those of a new figure.

    Raises
    ------
    ParameterError
        If `network` is not the one that was run.
    """
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    kinds = [synapse.kind for synapse in network.synapses]
    check_network("plot_weights.network", agreement, network)
    if ax is None:
        ax = Figure(figsize=(8, 3.6), layout="constrained").add_subplot()
    handles = []
    for kind, index in kind_indices(kinds).items():
        colour, name = KINDS[kind], f"{kind} ({index.size})"
        _draw(ax, agreement.weights[:, index], colour, f"{kind} discrete", is_hardware=False)
        _draw(ax, agreement.emulated_weights[:, index], colour, f"{kind} hardware", is_hardware=True)
        handles.append(Line2D([], [], color=colour, linewidth=2.5, label=name))
    if handles:
        handles.append(Line2D([], [], color=INK, linewidth=3, alpha=0.4, label="discrete"))
        handles.append(Line2D([], [], color=INK, linewidth=1.3, linestyle="--", label="hardware"))
        ax.legend(handles=handles, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=len(handles), frameon=False,
                  fontsize="small")  # fmt: skip
    else:
        ax.text(0.5, 0.5, "no synapses", transform=ax.transAxes, ha="center", va="center")
    ax.set(
        xlim=(0, len(agreement.weights)),
        ylim=(-0.02, 1.02),
        xlabel="executed timestep",
        ylabel="weight (median, quartiles)",
    )
    return ax


def _draw(ax: Axes, values: FloatArray, colour: str, name: str, *, is_hardware: bool) -> None:
    time = np.arange(len(values)) + 1
    low, high = np.quantile(values, (0.25, 0.75), axis=1)
    # The two often coincide: the hardware's thin dashes stay legible on the discrete one's broad line.
    style: dict[str, Any] = {"linewidth": 1.3, "linestyle": "--"} if is_hardware else {"linewidth": 3.4, "alpha": 0.4}
    ax.plot(time, np.median(values, axis=1), color=colour, gid=name, zorder=4 if is_hardware else 3, **style)
    if is_hardware:
        for edge in (low, high):
            ax.plot(time, edge, color=colour, linewidth=0.7, linestyle=":", zorder=2)
    else:
        ax.fill_between(time, low, high, color=colour, alpha=0.15, linewidth=0, gid=f"{name} quartiles", zorder=1)
