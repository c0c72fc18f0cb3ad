"""Figures, the HTML report of a feasibility study, and replay."""

from ohmloom.report._replay_data import Recording, recording_of
from ohmloom.report.arena_plot import plot_path
from ohmloom.report.crossbar_plot import plot_plan, plot_tile, plot_tile_values
from ohmloom.report.mapping_plot import plot_example, plot_schedule
from ohmloom.report.page import report_page, write_report
from ohmloom.report.replay import replay, replay_gif, replay_html, replay_png
from ohmloom.report.weights_plot import plot_weights

__all__ = [
    "Recording",
    "plot_example",
    "plot_path",
    "plot_plan",
    "plot_schedule",
    "plot_tile",
    "plot_tile_values",
    "plot_weights",
    "recording_of",
    "replay",
    "replay_gif",
    "replay_html",
    "replay_png",
    "report_page",
    "write_report",
]
