"""Quantum circuits of QUBOs: ansätze, classical training, and backends."""
