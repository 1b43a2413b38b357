"""What no daemon needs: instances, proofs, the paper's tables, scores.

It may import all daemons; none imports it.
"""
