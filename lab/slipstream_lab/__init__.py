"""The laboratory: it measures, trains, simulates and proves what the product does.

`simulation` has worlds and the closed loop, `research` instances, models and the paper's tables,
`benchmarks` figures with aims, `commands` the sub-commands that it adds to `slipstream`. It imports
the product; the product never imports it.
"""
