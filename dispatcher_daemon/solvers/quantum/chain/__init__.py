"""Circuits on a linear chain: order of the qubits, exact matrix product states, training, and
placement on a device."""
