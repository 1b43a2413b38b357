"""Tables of `slipstream_lab.benchmarks.quantum.gates`: successes with exact intervals, and paired tests."""

from __future__ import annotations

import statistics
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

Record = Mapping[str, Any]

CONFIDENCE: Final = 0.95


@dataclass(frozen=True)
class Arm:
    """A way to the optimum and how to read it from the runs of one instance and seed.

    Attributes:
        hit: whether the run found the optimum.
        train_s, sample_s: processor time, s.
    """

    title: str
    hit: Callable[[Record], bool]
    train_s: Callable[[Record], float]
    sample_s: Callable[[Record], float]


def _circuit(title: str, arm: str, of: str, stage: str) -> Arm:
    return Arm(
        title,
        lambda run: bool(run[arm][of][stage]),
        lambda run: float(run[arm]["train_s"]),
        lambda run: float(run[arm]["sample_s"]),
    )


ARMS: Final = (
    _circuit("with gates, samples of the circuit", "gates", "circuit", "raw"),
    _circuit("with gates, samples of its marginals", "gates", "marginals", "raw"),
    Arm(
        "with gates, its likeliest bits, no samples",
        lambda run: bool(run["gates"]["likeliest"]),
        lambda run: float(run["gates"]["train_s"]),
        lambda _: 0.0,
    ),
    _circuit("without gates, samples", "product", "circuit", "raw"),
    _circuit("with gates, samples descended", "gates", "circuit", "descended"),
    _circuit("with gates, samples of its marginals descended", "gates", "marginals", "descended"),
    _circuit("without gates, samples descended", "product", "circuit", "descended"),
    Arm(
        "random starts, descended",
        lambda run: bool(run["random"]["hit"]),
        lambda _: 0.0,
        lambda run: float(run["random"]["cpu_s"]),
    ),
)

PAIRS: Final = ((0, 1), (0, 3), (4, 5), (4, 6))
"""Arms that are compared, by number: what the gates add to sampling, and to training."""


def interval(hits: int, runs: int) -> tuple[float, float]:
    """Clopper and Pearson's exact interval of a share, 95 %."""
    from scipy.stats import binomtest

    found = binomtest(hits, runs).proportion_ci(CONFIDENCE, method="exact")
    return float(found.low), float(found.high)


def paired(first: Sequence[bool], second: Sequence[bool]) -> tuple[int, int, float]:
    """McNemar's exact test: runs that only the first hit, that only the second hit, two-sided p."""
    from scipy.stats import binomtest

    only = [a for a, b in zip(first, second, strict=True) if a != b]
    ahead = sum(only)
    p = float(binomtest(ahead, len(only)).pvalue) if only else 1.0
    return ahead, len(only) - ahead, p


def sign_test(
    instances: Sequence[str], first: Sequence[bool], second: Sequence[bool]
) -> tuple[int, int, float]:
    """Instances with more hits of the first, of the second, and the two-sided sign test's p.

    Runs of one instance depend on each other; its difference is one observation here.
    """
    sums: dict[str, int] = defaultdict(int)
    for name, a, b in zip(instances, first, second, strict=True):
        sums[name] += int(a) - int(b)
    signs = [value > 0 for value in sums.values() if value]
    return paired(signs, [not sign for sign in signs])


def tables(runs: Mapping[str, Sequence[Record]]) -> Iterable[str]:
    """Markdown: one table of successes, of pairs, and of tabu's reads."""
    yield "| encoding | arm | runs | hits | share, 95 % | training, CPU s | sampling, CPU s |"
    yield "|---|---|--:|--:|--:|--:|--:|"
    for encoding, records in runs.items():
        for arm in ARMS if records else ():
            hits = sum(map(arm.hit, records))
            low, high = interval(hits, len(records))
            yield (
                f"| {encoding} | {arm.title} | {len(records)} | {hits} | "
                f"{100 * hits / len(records):.1f} % ({100 * low:.1f}-{100 * high:.1f}) | "
                f"{_spread([arm.train_s(r) for r in records])} | "
                f"{_spread([arm.sample_s(r) for r in records])} |"
            )
    yield ""
    yield "| encoding | pair | only first, only second, p (runs) | the same (instances) |"
    yield "|---|---|--:|--:|"
    for encoding, records in runs.items():
        names = [str(r["instance"]) for r in records]
        for one, two in PAIRS if records else ():
            first, second = ([ARMS[k].hit(r) for r in records] for k in (one, two))
            by_run, by_instance = paired(first, second), sign_test(names, first, second)
            yield (
                f"| {encoding} | {ARMS[one].title} – {ARMS[two].title} | {_test(by_run)} | "
                f"{_test(by_instance)} |"
            )
    yield ""
    yield (
        "| encoding | tabu reads | raw hits, 95 % | repaired | calls without a raw hit "
        "| CPU s a call |"
    )
    yield "|---|--:|--:|--:|--:|--:|"
    for encoding, records in runs.items():
        calls = [r["tabu"] for r in records if r.get("tabu")]
        if not calls:
            continue
        reads = sum(c["reads"] for c in calls)
        raw, repaired = (sum(c[stage] for c in calls) for stage in ("raw", "repaired"))
        low, high = interval(raw, reads)
        yield (
            f"| {encoding} | {reads} | {100 * raw / reads:.2f} % "
            f"({100 * low:.2f}-{100 * high:.2f}) | {100 * repaired / reads:.2f} % | "
            f"{sum(c['raw'] == 0 for c in calls)} of {len(calls)} | "
            f"{_spread([c['cpu_s'] for c in calls])} |"
        )


def _spread(values: Sequence[float]) -> str:
    if not any(values):
        return ""
    deviation = statistics.stdev(values) if len(values) > 1 else 0.0
    digits = 2 if statistics.mean(values) >= 0.1 else 4
    return f"{statistics.mean(values):.{digits}f} ± {deviation:.{digits}f}"


def _test(found: tuple[int, int, float]) -> str:
    ahead, behind, p = found
    return f"{ahead}, {behind}, p = {p:.2g}"
