"""Adapt a configuration to what a run's source and registration turn out to be."""

from typing import TYPE_CHECKING

from msgspec.structs import replace

from haptigraph.config import Config, HapticsConfig, RunConfig
from haptigraph.registration.assumed import needs_consent
from haptigraph.stages import Source

if TYPE_CHECKING:
    from haptigraph.registration.registered import BaseRegistration

__all__ = ["suited"]

PERIODS = 1.5
"""For how many periods of volumes an output or an image is valid."""
MAX_DEADMAN_MS = 1000.0


def suited(config: Config, source: Source, registration: "BaseRegistration") -> Config:
    """Return the configuration that a run uses.

    Nothing vibrates if the registration assumes what nobody accepted. Volumes come more slowly than images,
    so a dead-man timer and a limit of staleness that are not set become one and a half of their periods.

    Args:
        config: As configured.
        source: The opened source.
        registration: The run's registration.
    """
    if needs_consent(registration.assumed) and not config.haptics.accept_assumed:
        config = config.silenced()
    if registration.image.slices is None:
        return config
    valid_ms, haptics, run = PERIODS * 1e3 / source.rate_hz, config.haptics, config.run
    if haptics.deadman_ms == HapticsConfig().deadman_ms < valid_ms:
        haptics = replace(haptics, deadman_ms=min(valid_ms, MAX_DEADMAN_MS))
    if run.stale_ms == RunConfig().stale_ms < valid_ms:
        run = replace(run, stale_ms=valid_ms)
    return replace(config, haptics=haptics, run=run)
