"""Shapes, shades and letters of the animation, drawn with Pillow."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from ohmloom.report._replay_data import (
    ACTIONS,
    INK,
    IR_COLOUR,
    KINDS,
    LIGHT_COLOUR,
    ArenaView,
    Recording,
    goal_regions,
    sensor_rays,
    start_region,
)

if TYPE_CHECKING:
    from PIL.Image import Image
    from PIL.ImageDraw import ImageDraw
    from PIL.ImageFont import FreeTypeFont

SMOOTH: Final = 2  # drawn this many times larger, then averaged down
PAPER, PALE, WALL = "#ffffff", "#e8e8e8", "#d6d6d6"
GOAL, START, LAMP, EMPTY = "#d9efdf", "#e4e7ee", "#f2c200", "#f1f1f1"
Box = tuple[float, float, float, float]


@dataclass(frozen=True, kw_only=True)
class Lens:
    """Maps metres to pixels: the square of half width `reach` around `centre` fills the box."""

    left: float
    top: float
    scale: float

    @classmethod
    def over(cls, box: Box, centre: tuple[float, float], reach: float) -> Lens:
        scale = SMOOTH * (box[2] - box[0]) / (2 * reach)
        return cls(left=SMOOTH * box[0] - scale * (centre[0] - reach),
                   top=SMOOTH * box[1] + scale * (centre[1] + reach), scale=scale)  # fmt: skip

    def pixels(self, points: npt.ArrayLike) -> list[tuple[float, float]]:
        return [(self.left + self.scale * float(x), self.top - self.scale * float(y)) for x, y in np.asarray(points)]


def draw_world(draw: ImageDraw, recording: Recording, arena: ArenaView, lens: Lens) -> None:
    for region in goal_regions(recording.trial, arena):
        draw.polygon(lens.pixels(region), fill=GOAL)
    draw.polygon(lens.pixels(start_region(arena)), fill=START)
    for half, fill in ((arena.half_width, None), (arena.box_half_width, WALL)):
        corners = lens.pixels([(-half, half), (half, -half)])
        draw.rectangle([*corners[0], *corners[1]], outline=INK, width=2 * SMOOTH, fill=fill)
    disc(draw, lens, np.asarray(arena.lamp, dtype=np.float64), 1.2 * arena.robot_radius, LAMP)


def draw_robot(draw: ImageDraw, recording: Recording, arena: ArenaView, lens: Lens, row: int) -> None:
    pose = recording.trial.path[row]
    sensed = recording.trial.sensors[min(row, recording.timesteps - 1)]
    near, far = sensor_rays(pose, arena)
    for sensor in range(3):
        ray = lens.pixels([near[sensor], far[sensor]])
        draw.line(ray, fill=lit(IR_COLOUR, sensed[sensor]), width=2 * SMOOTH)
    disc(draw, lens, pose[:2], arena.robot_radius, PAPER)
    ahead = pose[:2] + 0.75 * arena.robot_radius * np.array([np.cos(pose[2]), np.sin(pose[2])])
    draw.line(lens.pixels([pose[:2], ahead]), fill=INK, width=2 * SMOOTH)
    for sensor in range(3):
        disc(draw, lens, near[sensor], 0.2 * arena.robot_radius, lit(LIGHT_COLOUR, sensed[3 + sensor]))


def disc(draw: ImageDraw, lens: Lens, centre: npt.NDArray[Any], radius: float, fill: str | tuple[int, ...]) -> None:
    (x, y), r = lens.pixels([centre])[0], lens.scale * radius
    draw.ellipse((x - r, y - r, x + r, y + r), fill=fill, outline=INK, width=max(1, SMOOTH // 2))


def scaled(box: Box) -> Box:
    left, top, right, bottom = box
    return (left * SMOOTH, top * SMOOTH, right * SMOOTH, bottom * SMOOTH)


def rgb(colour: str) -> tuple[int, int, int]:
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def lit(colour: str, share: float) -> tuple[int, ...]:
    """From pale at 0 to full colour at 1."""
    share = min(1.0, max(0.0, float(share)))
    return tuple(round(a + share * (b - a)) for a, b in zip(rgb("#dedede"), rgb(colour), strict=True))


def fitted(font: FreeTypeFont, text: str, width: float) -> str:
    """`text` on one line, cut to `width` pixels."""
    text = " ".join(text.split())
    if font.getlength(text) <= width:
        return text
    while text and font.getlength(text + "…") > width:
        text = text[: -max(1, len(text) // 16)]
    return text + "…"


def font_file() -> str:
    # matplotlib ships DejaVu Sans, so that text looks the same on every machine.
    import matplotlib

    return str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf")


def palette() -> Image:
    """One palette for all frames: each colour in shades towards paper, and greys."""
    from PIL import Image

    values = [channel for colour in (PAPER, GOAL, START, WALL, PALE, EMPTY) for channel in rgb(colour)]
    # Few near-white entries: Pillow looks colours up coarsely, and would tint the paper.
    for level in range(0, 240, 5):
        values += [level] * 3
    for colour in (IR_COLOUR, LIGHT_COLOUR):
        for share in np.linspace(0.0, 1.0, 24):
            values += lit(colour, share)
    for colour in (*ACTIONS.values(), *KINDS.values(), LAMP):
        for share in np.linspace(0.25, 1.0, 16):
            values += [round(255 + share * (channel - 255)) for channel in rgb(colour)]
    assert len(values) <= 3 * 256
    image = Image.new("P", (1, 1))
    image.putpalette(values)
    return image
