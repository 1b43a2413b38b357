"""Proofs that QUBOs are equivalent to their problems, by enumeration and exact elimination."""
