"""The front door: the command `slipstream`."""
