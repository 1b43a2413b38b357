"""What all Slipstream daemons share: roads, messages, bus, energy, settings, service life."""

__version__ = "0.4.0"
