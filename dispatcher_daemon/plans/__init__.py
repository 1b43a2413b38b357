"""What goes out: candidate plans, their physical energy, their verification and their messages."""
