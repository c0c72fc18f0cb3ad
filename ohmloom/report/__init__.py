"""Figures, replay and the HTML report."""
