"""The replay as one HTML file that plays by itself, without network."""

from __future__ import annotations

import base64
import json
import zlib
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ohmloom._files import write_atomic
from ohmloom.report._replay_data import (
    ACTIONS,
    IR_COLOUR,
    KINDS,
    LIGHT_COLOUR,
    OUTPUTS,
    SENSORS,
    STEPS,
    ArenaView,
    Recording,
    bump_rows,
    goal_regions,
    start_region,
)

# What could end the script element, or a line of JavaScript, is written as a JSON escape.
ESCAPES = {ord(character): f"\\u{ord(character):04x}" for character in "<>&\u2028\u2029"}


def replay_html(recording: Recording, arena: ArenaView, path: Path | str) -> None:
    """Write the player: arena, sensors, spikes and weights, with slider, speed and keys.

    One file with script, style and data inside; positions to 0.1 mm, weights and sensors to 1e-4.

    Raises
    ------
    OperationError
        If the file cannot be written.
    """
    write_atomic(path, replay_page(recording, arena))


def replay_page(recording: Recording, arena: ArenaView) -> str:
    """Compose the page that `replay_html` writes."""
    from markupsafe import Markup

    return render(
        "replay.html",
        name=recording.network_name,
        summary=recording.summary,
        last_row=recording.timesteps,
        actions=ACTIONS,
        kinds=kind_legend(recording),
        ir_colour=IR_COLOUR,
        light_colour=LIGHT_COLOUR,
        script=Markup(template("replay.js")),
        drawing=Markup(template("replay_draw.js")),
        style=Markup(template("replay.css") + template("replay_parts.css")),
        data=Markup(json_text(replay_data(recording, arena))),
    )


def template(name: str) -> str:
    """Text of a file of the templates."""
    return (resources.files("ohmloom.report") / "templates" / name).read_text(encoding="utf-8")


def render(page: str, /, **context: Any) -> str:
    """Fill a template; whatever is not markup is escaped, and what is missing is an error."""
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(template), autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True,
        lstrip_blocks=True, keep_trailing_newline=True,
    )  # fmt: skip
    return environment.get_template(page).render(**context).lstrip("\n")


def kind_legend(recording: Recording) -> dict[str, tuple[str, int]]:
    """Colour and number of the synapses of each kind."""
    return {kind: (KINDS[kind], len(index)) for kind, index in recording.kinds.items()}


def replay_data(
    recording: Recording, arena: ArenaView, *, most_weights: int | None = None, is_deflated: bool = False
) -> dict[str, Any]:
    """What the player's script draws; at most so many rows of weights, evenly apart, if a number is given.

    Deflated, the numbers take a tenth of the bytes, and the page has to inflate them before it starts the player.
    """
    trial = recording.trial
    path = np.array(trial.path, dtype=np.float64)
    path[:, 2] = np.remainder(path[:, 2] + np.pi, 2 * np.pi) - np.pi  # small enough to be packed
    extra = np.diff(np.asarray(trial.st, dtype=np.int64)) - 1
    order = [int(i) for index in recording.kinds.values() for i in index]
    stride = 1 if most_weights is None else max(1, -(-recording.timesteps // most_weights))
    return {
        "arena": {
            "half": float(arena.half_width),
            "box": float(arena.box_half_width),
            "lamp": np.asarray(arena.lamp, dtype=np.float64).tolist(),
            "radius": float(arena.robot_radius),
            "points": np.asarray(arena.sensor_points, dtype=np.float64).tolist(),
            "bearings": np.asarray(arena.sensor_bearings, dtype=np.float64).tolist(),
            "range": float(arena.ir_range),
            "goals": [region.tolist() for region in goal_regions(trial, arena)],
            "start": start_region(arena).tolist(),
        },
        "timesteps": recording.timesteps,
        "steps": STEPS,
        "stride": stride,
        "path": _packed(path, 1e-4, is_deflated),
        "sensors": _packed(trial.sensors, 1e-4, is_deflated),
        "actions": "".join(str(int(action)) for action in trial.actions),
        "outputs": _packed(trial.output_spikes, 1.0, is_deflated),
        "bumps": bump_rows(trial).tolist(),
        "extra": [[int(row), int(extra[row])] for row in np.flatnonzero(extra)],
        "spikes": _packed(recording.spikes, 1.0, is_deflated),
        "weights": _packed(recording.weights[::stride, order], 1e-4, is_deflated),
        "names": {
            "actions": list(ACTIONS),
            "sensors": list(SENSORS),
            "outputs": list(OUTPUTS),
            "neurons": list(recording.neuron_labels),
            "synapses": [recording.synapse_labels[i] for i in order],
            "kinds": [recording.synapse_kinds[i] for i in order],
        },
        "colours": {
            "actions": list(ACTIONS.values()),
            "kinds": KINDS,
            "ir": IR_COLOUR,
            "light": LIGHT_COLOUR,
        },
    }


def _packed(values: npt.ArrayLike, unit: float, is_deflated: bool) -> dict[str, Any]:
    """Fixed point: multiples of `unit`, or of a larger one if the range asks for it; 16 bits, counts in 8."""
    array = np.asarray(values, dtype=np.float64)
    largest = float(np.abs(array).max()) if array.size else 0.0
    unit = max(unit, largest / 32767)
    size = 1 if unit == 1.0 and largest <= 127 else 2
    codes = np.round(array / unit).astype(f"<i{size}").tobytes()
    return {
        "unit": unit,
        "size": size,
        "columns": int(array.shape[1]),
        "deflated": is_deflated,
        "codes": base64.b64encode(zlib.compress(codes, 9) if is_deflated else codes).decode("ascii"),
    }


def json_text(value: Any) -> str:
    """JSON that can stand inside a script element, whatever names are in it."""
    return json.dumps(value, separators=(",", ":"), allow_nan=False).translate(ESCAPES)
