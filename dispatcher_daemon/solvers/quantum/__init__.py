"""Quantum circuits of QUBOs: what they are, their training without a device, and where they run."""
