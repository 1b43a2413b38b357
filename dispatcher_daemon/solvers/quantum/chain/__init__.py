"""Circuits on a linear chain: order of the qubits, exact matrix product states, training, and the
place of the chain on a device."""
