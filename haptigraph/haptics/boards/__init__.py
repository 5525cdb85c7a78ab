"""Actuators on a board with the stock sketch StandardFirmata."""
