"""Training of the detector on domain-randomised scenes (the `train` extra)."""
