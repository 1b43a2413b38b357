"""Which number formats the CPU is fast with."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import openvino as ov

_INT8_FLAGS = frozenset({"avx2", "amx_int8", "asimddp", "i8mm"})


@cache
def _flags() -> frozenset[str]:
    """The processor's features by Linux's names; empty where it does not tell."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return frozenset()
    kinds = ("flags", "Features")
    return frozenset(word for line in lines if line.startswith(kinds) for word in line.split())


def fast_int8() -> bool:
    """Whether it multiplies bytes faster than floats (AVX2, AMX, Arm's dot products)."""
    return bool(_INT8_FLAGS & _flags())


def float_precision() -> ov.Type:
    """bf16 only where there are matrix tiles for it (AMX): without, f32 is faster."""
    return ov.Type.bf16 if "amx_bf16" in _flags() else ov.Type.f32
