"""An animation of a trial, drawn with Pillow."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from ohmloom._files import write_atomic
from ohmloom.errors import ParameterError
from ohmloom.report._replay_data import (
    ACTIONS,
    BACKED_OFF,
    INK,
    IR_COLOUR,
    KINDS,
    LIGHT_COLOUR,
    OUTPUTS,
    SENSORS,
    STEPS,
    ArenaView,
    Recording,
    bump_rows,
)
from ohmloom.report._replay_draw import (
    EMPTY,
    PALE,
    PAPER,
    SMOOTH,
    Box,
    Lens,
    draw_robot,
    draw_world,
    fitted,
    font_file,
    palette,
    scaled,
)

if TYPE_CHECKING:
    from PIL.Image import Image
    from PIL.ImageDraw import ImageDraw
    from PIL.ImageFont import FreeTypeFont

SIZE: Final = (760, 500)
FRAMES: Final = 200
FRAME_MS, LAST_FRAME_MS = 50, 2000
ARENA_BOX: Final[Box] = (12, 46, 452, 486)
CLOSE_BOX: Final[Box] = (468, 46, 604, 182)
BARS_BOX: Final[Box] = (614, 46, 748, 182)
RASTER_BOX: Final[Box] = (468, 208, 748, 338)  # all timesteps, uncovered as time goes on
WEIGHT_BOX: Final[Box] = (468, 364, 748, 470)


def replay_gif(recording: Recording, arena: ArenaView, path: Path | str, *, every: int | None = None) -> None:
    """Write an animation: arena with trail, close-up with lit sensors, spikes so far, weights.

    Parameters
    ----------
    every
        Timesteps from one frame to the next; by default as many as keep the animation within 200 frames. The
        first and the last position are always shown.

    Raises
    ------
    ParameterError
        If `every` is below 1.
    OperationError
        If the file cannot be written.
    """
    from PIL import Image

    if every is None:
        every = -(-recording.timesteps // (FRAMES - 1))
    if every < 1:
        raise ParameterError(f"replay_gif.every: expected at least 1 timestep, got {every}. Use 1 for each timestep.")
    rows = [*range(0, recording.timesteps, every), recording.timesteps]
    colours = palette()
    scene = _Scene.of(recording, arena)
    frames = []
    previous = 0
    for row in rows:
        scene.extend_trail(previous, row)
        frames.append(scene.frame(row).quantize(palette=colours, dither=Image.Dither.NONE))
        previous = row
    buffer = io.BytesIO()
    durations = [FRAME_MS] * (len(frames) - 1) + [LAST_FRAME_MS]
    frames[0].save(buffer, format="GIF", save_all=True, append_images=frames[1:], duration=durations, loop=0)
    write_atomic(path, buffer.getvalue())


@dataclass(frozen=True, kw_only=True, eq=False)
class _Scene:
    """What does not change from frame to frame; only the trail on `ground` grows."""

    recording: Recording
    arena: ArenaView
    ground: Image
    raster: Image
    font: FreeTypeFont

    @classmethod
    def of(cls, recording: Recording, arena: ArenaView) -> _Scene:
        from PIL import Image, ImageDraw, ImageFont

        font = ImageFont.truetype(font_file(), 11 * SMOOTH, layout_engine=ImageFont.Layout.BASIC)
        ground = Image.new("RGB", (SIZE[0] * SMOOTH, SIZE[1] * SMOOTH), PAPER)
        scene = cls(recording=recording, arena=arena, ground=ground, raster=_raster(recording), font=font)
        draw = ImageDraw.Draw(ground)
        draw_world(draw, recording, arena, Lens.over(ARENA_BOX, (0.0, 0.0), 1.02 * arena.half_width))
        scene.write(draw, 12, 6, fitted(font, recording.network_name, (SIZE[0] - 24) * SMOOTH))
        scene.write(draw, 12, 24, fitted(font, recording.summary, (SIZE[0] - 24) * SMOOTH), "#555555")
        scene.write(draw, RASTER_BOX[0], 190, f"spikes, {len(recording.neuron_labels)} neurons, first on top")
        scene.write(
            draw,
            WEIGHT_BOX[0],
            346,
            f"weights, {len(recording.synapse_labels)} synapses, 0 to {scene.top:.3g}",
        )
        x = WEIGHT_BOX[0]
        for kind in recording.kinds:
            draw.rectangle(scaled((x, 479, x + 9, 488)), fill=KINDS[kind])
            scene.write(draw, x + 13, 476, kind)
            x += 22 + font.getlength(kind) / SMOOTH
        return scene

    @property
    def top(self) -> float:
        weights = self.recording.weights
        return max(1.0, float(weights.max())) if weights.size else 1.0

    def write(self, draw: ImageDraw, x: float, y: float, text: str, fill: str = INK) -> None:
        draw.text((x * SMOOTH, y * SMOOTH), text, fill=fill, font=self.font)

    def extend_trail(self, first: int, last: int) -> None:
        from PIL import ImageDraw

        draw = ImageDraw.Draw(self.ground)
        lens = Lens.over(ARENA_BOX, (0.0, 0.0), 1.02 * self.arena.half_width)
        colours = list(ACTIONS.values())
        bumps = set(bump_rows(self.recording.trial).tolist())
        for row in range(first, last):
            ends = lens.pixels(self.recording.trial.path[row : row + 2, :2])
            colour = BACKED_OFF if row in bumps else colours[int(self.recording.trial.actions[row])]
            draw.line(ends, fill=colour, width=2 * SMOOTH)

    def frame(self, row: int) -> Image:
        """Robot at `row` of the path, with what it sensed there and did next (at the end: did last)."""
        from PIL import ImageDraw

        image = self.ground.copy()
        draw = ImageDraw.Draw(image)
        timestep = min(row, self.recording.timesteps - 1)
        lens = Lens.over(ARENA_BOX, (0.0, 0.0), 1.02 * self.arena.half_width)
        draw_robot(draw, self.recording, self.arena, lens, row)
        self._close_up(image, row)
        self._bars(draw, timestep)
        self._uncover(image, draw, timestep)
        self._weights(draw, timestep)
        action = list(ACTIONS)[int(self.recording.trial.actions[timestep])]
        counted = int(self.recording.trial.st[row])
        self.write(draw, 24, 464, f"timestep {row}, counted {counted}: {'end' if row > timestep else action}")
        return image.reduce(SMOOTH)

    def _close_up(self, image: Image, row: int) -> None:
        from PIL import Image, ImageDraw

        width = round((CLOSE_BOX[2] - CLOSE_BOX[0]) * SMOOTH)
        part = Image.new("RGB", (width, width), PAPER)
        draw = ImageDraw.Draw(part)
        x, y = (float(value) for value in self.recording.trial.path[row, :2])
        reach = 3.6 * self.arena.robot_radius
        lens = Lens.over((0, 0, width / SMOOTH, width / SMOOTH), (x, y), reach)
        draw_world(draw, self.recording, self.arena, lens)
        draw_robot(draw, self.recording, self.arena, lens, row)
        draw.rectangle((0, 0, width - 1, width - 1), outline=INK, width=SMOOTH)
        image.paste(part, (round(CLOSE_BOX[0] * SMOOTH), round(CLOSE_BOX[1] * SMOOTH)))

    def _bars(self, draw: ImageDraw, timestep: int) -> None:
        trial = self.recording.trial
        shares = [*trial.sensors[timestep], *(trial.output_spikes[timestep] / STEPS)]
        colours = [IR_COLOUR] * 3 + [LIGHT_COLOUR] * 3 + ["#0072b2"] * 2
        pitch = (BARS_BOX[3] - BARS_BOX[1]) / len(shares)
        for line, (name, share, colour) in enumerate(zip((*SENSORS, *OUTPUTS), shares, colours, strict=True)):
            y = BARS_BOX[1] + pitch * line
            self.write(draw, BARS_BOX[0], y, name)
            left, right = BARS_BOX[0] + 78, BARS_BOX[2]
            draw.rectangle(scaled((left, y + 2, right, y + 12)), fill=PALE)
            if share > 0:
                draw.rectangle(scaled((left, y + 2, left + float(share) * (right - left), y + 12)), fill=colour)

    def _uncover(self, image: Image, draw: ImageDraw, timestep: int) -> None:
        left, top, right, bottom = (round(edge) for edge in scaled(RASTER_BOX))
        now = round((right - left) * (timestep + 1) / self.recording.timesteps)
        draw.rectangle((left, top, right, bottom), fill=EMPTY)
        image.paste(self.raster.crop((0, 0, now, bottom - top)), (left, top))
        draw.line((left + now, top, left + now, bottom), fill=IR_COLOUR, width=SMOOTH)

    def _weights(self, draw: ImageDraw, timestep: int) -> None:
        left, top, right, bottom = WEIGHT_BOX
        draw.rectangle(scaled(WEIGHT_BOX), fill=EMPTY)
        order = [(kind, index) for kind, found in self.recording.kinds.items() for index in found]
        pitch = (right - left) / max(1, len(order))
        for place, (kind, index) in enumerate(order):
            height = max(0.0, float(self.recording.weights[timestep, index])) / self.top * (bottom - top)
            x = left + pitch * place
            draw.rectangle(scaled((x, bottom - height, x + 0.8 * pitch, bottom)), fill=KINDS[kind])


def _raster(recording: Recording) -> Image:
    """Spikes of the whole trial; a pixel column shows the mean of the timesteps that it covers."""
    from PIL import Image, ImageOps

    left, top, right, bottom = RASTER_BOX
    columns = min(recording.timesteps, round(right - left))
    edges = np.arange(columns) * recording.timesteps // columns
    sizes = np.diff(edges, append=recording.timesteps)
    means = np.add.reduceat(recording.spikes, edges, axis=0) / sizes[:, None]
    shades = np.ascontiguousarray(np.round(means.T * (255 / STEPS)).astype(np.uint8))
    size = (round(right - left) * SMOOTH, round(bottom - top) * SMOOTH)
    if not shades.size:
        return Image.new("RGB", size, EMPTY)
    return ImageOps.colorize(Image.fromarray(shades).resize(size, Image.Resampling.NEAREST), EMPTY, INK)
