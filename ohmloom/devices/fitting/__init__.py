"""Fitting of device laws to measured sweeps."""
