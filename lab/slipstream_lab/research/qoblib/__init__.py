"""The referee of quantum routing: solvers and controls on QOBLIB's vehicle routing class."""
