"""Commands that run everything on one machine: the demo and the live world."""
