"""What the quantum solvers and their devices are measured by."""
