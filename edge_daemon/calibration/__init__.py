"""Calibrating a camera from points: the fit, its accuracy, files in and out, the grid."""
