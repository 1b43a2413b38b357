"""Whatever stands in a file: a line and exit status 2, or a valid result. No traceback, no hang."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random
from typing import Any

import pytest

from slipstream.errors import MAX_FAULTS

from .child import CPU_S, GROWTH_MB
from .mutations import NO_FILES, known_attacks, mutate
from .seeds import Kind, make_kinds

pytestmark = [pytest.mark.attack, pytest.mark.process, pytest.mark.slow, pytest.mark.timeout(7200)]

FILES, FULL_SIZE_FILES = 300, 10_000

ABSURD = ("nan", "inf", "-1e9", "1e400", "9" * 6000, "-" + "9" * 30, "x", "\udcff", "1" * 18)
COMMANDS = (
    "run --port VALUE",
    "run --interval VALUE",
    "run --hardware VALUE",
    "world --port VALUE",
    "world --fps VALUE",
    "world --rsus VALUE",
    "world --begin VALUE",
    "world --interval VALUE",
    "track none.mp4 --camera none.toml --threads VALUE",
    "clip streetdrive --out out --fps VALUE",
    "clip streetdrive --out out --seconds VALUE",
    "clip sumo --out out --fps VALUE",
    "clip sumo --out out --seconds VALUE",
    "clip sumo --out out --begin VALUE",
    "robustness none.jsonl --noise VALUE",
    "robustness none.jsonl --draws VALUE",
    "solve --instance none --gamma VALUE",
    "solve --instance none --deadline VALUE",
    "solve --instance none --options VALUE",
    "solve --instance none --p VALUE",
    "solve --instance none --shots VALUE",
    "bench quantum --instances VALUE",
    "bench quantum --shots VALUE",
    "bench quantum --layers VALUE",
    "verify --all --random VALUE",
    "verify none --gamma VALUE",
    "verify none --options VALUE",
    "resources --customers VALUE",
    "resources --vehicles VALUE",
    "evaluate --out out --stored --hours VALUE",
    "evaluate --out out --stored --begin VALUE",
    "evaluate --out out --stored --seeds VALUE",
    "model export none.pt --imgsz VALUE",
    "db prune --url sqlite:///none.db --keep-days VALUE",
    "db check --url VALUE",
    "db check --url postgresql://u@h:VALUE/x",
)
Run = Callable[[list[str], Path], dict[str, Any]]


@pytest.fixture(scope="module")
def run() -> Iterator[Run]:
    """Runs a command of `slipstream` in a folder, within limits."""
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    with subprocess.Popen(
        [sys.executable, str(Path(__file__).with_name("child.py"))],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=environment,
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        stdin, stdout = process.stdin, process.stdout

        def run(arguments: list[str], folder: Path) -> dict[str, Any]:
            stdin.write(json.dumps({"arguments": arguments, "folder": str(folder)}) + "\n")
            stdin.flush()
            outcome: dict[str, Any] = json.loads(stdout.readline())
            return outcome

        yield run
        stdin.close()


@pytest.fixture(scope="module")
def kinds(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Kind], Path]:
    """All kinds of files, and the folder of the valid ones."""
    folder = tmp_path_factory.mktemp("valid")
    return make_kinds(folder), folder


def fault_of(outcome: dict[str, Any], *, may_fail: bool, all_faults: bool = False) -> str | None:
    """What is wrong with how a command took a file; `check` tells all faults, a line each."""
    said = outcome["stderr"]
    if outcome["ended"]:
        return str(outcome["ended"])
    if outcome["cpu_s"] > CPU_S:
        return "took too long"
    if outcome["growth_mb"] > GROWTH_MB:
        return "grew too large"
    if "Traceback" in said or "Traceback" in outcome["stdout"]:
        return "a traceback"
    if outcome["status"] not in ((0, 1, 2) if may_fail else (0, 2)):
        return f"exit status {outcome['status']}"
    lines = said.splitlines()
    told = sum(line.startswith("slipstream: ") for line in lines)
    if outcome["status"] == 2 and not (
        told == len(lines) and 1 <= told <= (MAX_FAULTS if all_faults else 1)
    ):
        return "not one line a fault"
    return None


class Attack:
    """Runs hostile files and gathers what became of them."""

    def __init__(self, run: Run, folder: Path) -> None:
        self.outcomes: Counter[int] = Counter()
        self.faults: list[str] = []
        self.slowest = (0.0, "")
        self.largest = (0.0, "")
        self._run = run
        self._folder = folder

    def try_file(self, kind: Kind, valid: Path, name: str, put: Callable[[Path], None]) -> None:
        """Run the command of a kind on a file that `put` makes."""
        place = self._folder / "place"
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir()
        hostile = place / valid.name
        if kind.name == "model":
            (place / "hostile").mkdir()
            hostile = place / "hostile" / valid.name
            weights = valid.with_suffix(".bin")
            (place / "hostile" / weights.name).symlink_to(weights)
        put(hostile)
        outcome = self._run(kind.arguments(hostile, self._folder / "valid"), place)
        what = f"{kind.name}, {valid.name}, {name}"
        self.outcomes[outcome["status"]] += 1
        self.slowest = max(self.slowest, (outcome["cpu_s"], what))
        self.largest = max(self.largest, (outcome["growth_mb"], what))
        fault = fault_of(
            outcome, may_fail=kind.may_fail, all_faults=kind.command.startswith("check")
        )
        if fault is not None:
            figures = f"{outcome['cpu_s']:.1f} s, {outcome['growth_mb']:.0f} MB"
            self.faults.append(f"{what}: {fault} ({figures}): {outcome['stderr'][-800:]}")

    def report(self) -> str:
        """The figures in a line."""
        counts = ", ".join(f"{n} with status {s}" for s, n in sorted(self.outcomes.items()))
        return (
            f"{self.outcomes.total()} files: {counts}; slowest {self.slowest[0]:.1f} s "
            f"({self.slowest[1]}), largest growth {self.largest[0]:.0f} MB ({self.largest[1]}); "
            f"{len(self.faults)} faults"
        )


@pytest.fixture
def attack(run: Run, kinds: tuple[list[Kind], Path], tmp_path: Path) -> Attack:
    """An attack with nothing tried so far."""
    (tmp_path / "valid").symlink_to(kinds[1])
    return Attack(run, tmp_path)


@pytest.mark.long
def test_valid_files_are_accepted(attack: Attack, kinds: tuple[list[Kind], Path]) -> None:
    """So that what refuses hostile ones is not the command line."""
    for kind in kinds[0]:
        for valid in kind.files:
            attack.try_file(kind, valid, "valid", lambda path, v=valid: shutil.copy(v, path))  # type: ignore[misc]
    assert attack.faults == []
    assert attack.outcomes[0] >= 0.6 * attack.outcomes.total()


@pytest.mark.long
def test_what_is_no_file_is_refused(attack: Attack, kinds: tuple[list[Kind], Path]) -> None:
    """Pipes, devices, directories, sockets, links to nowhere, 20 GB."""
    for kind in kinds[0]:
        for name, put in NO_FILES.items():
            attack.try_file(kind, kind.files[0], name, put)
    assert attack.faults == []


@pytest.mark.long
def test_known_attacks_are_refused(
    attack: Attack, kinds: tuple[list[Kind], Path], figure: Callable[[str], None]
) -> None:
    """Pictures and nets of gigabytes, entity bombs, millions of rows, objects 3,000 deep."""
    by_name = {kind.name: kind for kind in kinds[0]}
    for number, (name, file, data) in enumerate(known_attacks(kinds[1])):
        kind = by_name[name]
        attack.try_file(
            kind,
            kinds[1] / file,
            f"known {number}",
            lambda path, content=data: path.write_bytes(content),  # type: ignore[misc]
        )
    figure(attack.report())
    assert attack.faults == [], "\n\n".join(attack.faults)
    assert set(attack.outcomes) == {2}


@pytest.mark.parametrize("value", ABSURD)
def test_absurd_options_are_refused(run: Run, tmp_path: Path, value: str) -> None:
    """Numbers out of all bounds, and what is none."""
    for command in COMMANDS:
        outcome = run([word.replace("VALUE", value) for word in command.split()], tmp_path)
        assert fault_of(outcome, may_fail=False) is None, (command, value, outcome)
        assert outcome["status"] == 2, (command, value, outcome)


def test_hostile_files_are_refused_in_one_line(
    attack: Attack,
    kinds: tuple[list[Kind], Path],
    full_size: bool,
    figure: Callable[[str], None],
) -> None:
    """Mutated, nonsensical and huge files of every kind; the same ones each time."""
    files = FULL_SIZE_FILES if full_size else FILES
    total = sum(kind.share for kind in kinds[0])
    for kind in kinds[0]:
        for number in range(max(2, round(files * kind.share / total))):
            rng = Random(f"{kind.name} {number}")
            valid = rng.choice(kind.files)
            what, data = mutate(valid.read_bytes(), rng, text=kind.text)
            attack.try_file(
                kind,
                valid,
                f"number {number}: {what}",
                lambda path, content=data: path.write_bytes(content),  # type: ignore[misc]
            )
    figure(attack.report())
    assert attack.faults == [], "\n\n".join(attack.faults)
