"""The worlds: rendered StreetDrive clips with their ground truth, and the detector's training."""
