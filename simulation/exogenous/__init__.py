"""The paper's own kind of evaluation: a fleet on recorded traffic that it does not change."""
