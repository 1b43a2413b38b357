"""QAOA simulated exactly: on all 2^n states, or on those with one option of each vehicle."""
