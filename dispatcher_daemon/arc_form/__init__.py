"""The paper's arc form of a cycle: candidate arcs with rewards, solved as one problem."""
