"""Instances with matrices of costs instead of roads, and the published sets read as such."""

from slipstream_lab.research.instances.matrices.instance import (
    MatrixInstance,
    has_matrices,
    matrix_instance_from,
    write_matrix_instance,
)
from slipstream_lab.research.instances.matrices.published_sets import read_published
from slipstream_lab.research.instances.matrices.search import MatrixPlan, search_matrix_instance

__all__ = [
    "MatrixInstance",
    "MatrixPlan",
    "has_matrices",
    "matrix_instance_from",
    "read_published",
    "search_matrix_instance",
    "write_matrix_instance",
]
