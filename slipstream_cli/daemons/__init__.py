"""Commands that run processes: each daemon alone, all on this machine, and the live world."""
