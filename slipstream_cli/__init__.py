"""The command line: `slipstream`."""
