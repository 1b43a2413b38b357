"""Domain-randomised scenes and the training of the detector (the `train` extra)."""
