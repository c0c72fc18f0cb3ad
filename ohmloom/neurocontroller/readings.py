"""The controller's settings: each choice that the paper leaves, by name, with the default reading."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from ohmloom._files import StrictModel

STEPS_PER_TIMESTEP = 21  # Section IX: output window size


class Readings(StrictModel):
    """Settings of the discrete controller; defaults follow Sections IV, V and IX where these are explicit.

    Attributes
    ----------
    lateral
        Which synapses are legal inside the hidden layer: from a higher to a lower index (``descending``, the
        letter of eq. 5), ``ascending``, or ``both``.
    synapse_gain
        What one spike adds to the membrane is ``synapse_gain * sign * W``; dimensionless, > 0.
    a, b, c, c_ini, y_thresh
        Constant current, leak, reset and initial membrane potential, threshold (eqs. 3 and 4).
    last_spike, stdp_threshold
        Value that a spike gives to ls, and the threshold of eqs. 10 and 11.
    weight_at
        Whether a travelling spike acts with the weight at its ``arrival`` or at its ``emission``.
    hidden_delay
        ``index``: \\|i_s - i_r\\| steps inside the hidden layer (eq. 5); ``one``: 1 step as everywhere else.
    input_bias
        Whether input neurons get the constant current `a` too.
    clamp
        Whether the membrane potential is kept at 0 from below.
    carry_state
        Whether membranes, ls and travelling spikes carry over from timestep to timestep.
    high_count
        Least number of spikes in 21 steps that makes an output *high* (eq. 6).
    """

    lateral: Literal["descending", "both", "ascending"] = "descending"
    synapse_gain: float = Field(default=0.25, gt=0.0)
    a: float = Field(default=0.3, ge=0.0)
    b: float = Field(default=0.05, ge=0.0, le=1.0)
    c: float = Field(default=0.0, ge=0.0)
    c_ini: float = Field(default=0.5, ge=0.0)
    y_thresh: float = Field(default=1.0, gt=0.0)
    last_spike: int = Field(default=3, ge=1, le=127)
    stdp_threshold: int = Field(default=4, ge=0, le=254)
    weight_at: Literal["arrival", "emission"] = "arrival"
    hidden_delay: Literal["index", "one"] = "index"
    input_bias: bool = True
    clamp: bool = True
    carry_state: bool = True
    high_count: int = Field(default=11, ge=0, le=STEPS_PER_TIMESTEP + 1)
