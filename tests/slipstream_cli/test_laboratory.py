"""The command without a laboratory, with one, and with one that is broken."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path

import pytest

from slipstream_cli import laboratory
from slipstream_cli.main import main, parser

Install = Callable[..., None]


@pytest.fixture
def install(monkeypatch: pytest.MonkeyPatch) -> Iterator[Install]:
    """Makes packages be installed that have these entry points, and no others."""

    def only(*points: EntryPoint) -> None:
        found = EntryPoints(points)
        monkeypatch.setattr("slipstream_cli.laboratory.entry_points", lambda: found)
        laboratory._loaded.cache_clear()

    yield only
    laboratory._loaded.cache_clear()


def refusal(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """The one line of a command that is refused with exit status 2."""
    with pytest.raises(SystemExit) as ended:
        raise SystemExit(main(arguments))
    assert ended.value.code == 2
    line = capsys.readouterr().err.strip()
    assert "\n" not in line
    return line


def test_without_a_laboratory_its_commands_are_told_of(
    install: Install, capsys: pytest.CaptureFixture[str]
) -> None:
    """`slipstream run` is refused in one line that says where the further commands come from."""
    install()
    line = refusal(["run"], capsys)
    assert line.startswith("slipstream: no such command: run; ")
    assert "more come with the laboratory: pip install ./lab" in line


def test_without_a_laboratory_what_needs_it_says_so(
    install: Install, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An instance is neither checked nor exported in silence, and its sets are no formats."""
    install()
    instance = tmp_path / "instance.json"
    instance.write_text('{"format": 1}')
    for arguments in (
        ["check", str(instance)],
        ["export", "instance", "all", "--out", str(tmp_path / "out")],
    ):
        assert "the laboratory is not installed; pip install ./lab" in refusal(arguments, capsys)
    assert "vrplib" in refusal(["import", "vrplib", "x", "--out", str(tmp_path)], capsys)


def test_a_laboratory_that_cannot_be_loaded_keeps_no_daemon_from_its_start(
    install: Install, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its command is missing, and a line says why; all others are there."""
    broken = "no_such_package.world:add_to"
    install(
        EntryPoint("world", broken, "slipstream.commands"),
        EntryPoint("import-sets", broken, "slipstream.laboratory"),
    )
    options = parser().parse_args(["dispatcher", "--config", "site.toml"])
    assert options.command == "dispatcher"
    told = capsys.readouterr().err
    assert f"slipstream world: {broken} cannot be loaded: " in told
    assert f"slipstream import-sets: {broken} cannot be loaded: " in told
