"""What no daemon needs: instances, synthetic cities, proofs, the paper's tables, scores.

It may import all daemons; none imports it. An installation from a wheel does not contain it.
"""
