"""Accuracy of perception: clips of both worlds against their ground truth."""
