"""Thousands of simulated participants through one study, on this machine or on a Dask cluster."""
