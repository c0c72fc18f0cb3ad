"""Many devices: crossbars with wire resistance.

Axes are ``(..., word_line, bit_line)``; leading axes are a batch. Current is positive into the sense of a column.
"""

from __future__ import annotations

from ohmloom.circuits.crossbar import Crossbar, Read

__all__ = ["Crossbar", "Read"]
