"""Sweeps: a study's trials with thousands of simulated participants, on this machine or a Dask cluster."""
