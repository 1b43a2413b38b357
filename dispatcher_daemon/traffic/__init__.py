"""Traffic: segment states of RSUs, how they are received, and what of them opens a gate."""
