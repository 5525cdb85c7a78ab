"""Devices with force; `run_force.FORCE_DEVICES` names them."""
