"""The command line as a whole: every option is explained, and misspelt names are understood."""

from __future__ import annotations

import argparse
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from slipstream_cli import laboratory
from slipstream_cli.main import COMMANDS, GROUPS, main, parser


def parsers(of: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    """A parser and those of its sub-commands."""
    yield of
    for action in of._actions:
        if isinstance(action, argparse._SubParsersAction):
            for command in dict.fromkeys(action.choices.values()):
                yield from parsers(command)


def test_every_option_has_a_description_and_a_default() -> None:
    """Of all sub-commands: a description, a help for each argument, and what holds without it."""
    faults = []
    for command in parsers(parser()):
        if not command.description:
            faults.append(f"{command.prog}: no description")
        shown = " ".join(command.format_help().split())
        if "?." in shown or ". (default" in shown:
            faults.append(f"{command.prog}: a full stop in the wrong place")
        for action in command._actions:
            if isinstance(action, argparse._SubParsersAction) or action.help == argparse.SUPPRESS:
                continue
            name = f"{command.prog} {action.option_strings or action.dest}"
            text = command._get_formatter()._expand_help(action)
            if not action.help:
                faults.append(f"{name}: no help")
            takes_value = action.option_strings and action.nargs != 0
            if takes_value and not action.required and "default" not in text:
                faults.append(f"{name}: no default")
            if " ".join(text.split())[:20] not in shown and command.prog != "slipstream":
                faults.append(f"{name}: not in the help")
    assert faults == []


def test_the_help_of_all_fits_one_screen(capsys: pytest.CaptureFixture[str]) -> None:
    """Each sub-command once, on a line of its own that is whole, under its group."""
    with pytest.raises(SystemExit) as ended:
        main(["--help"])
    assert ended.value.code == 0
    lines = capsys.readouterr().out.splitlines()
    groups = [*GROUPS, "laboratory"]
    assert len(lines) <= 48
    assert max(map(len, lines)) <= 79
    assert [line.rstrip(":") for line in lines if line.rstrip(":") in groups] == groups
    listed = [line.split()[0] for line in lines if line.startswith("  ")]
    assert listed == [*COMMANDS, *laboratory.commands()]
    assert not [line for line in lines[1:] if line.endswith("...")]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["dispatchr"], "no such command: dispatchr; did you mean dispatcher?"),
        (["net", "fnd", "x"], "no such command: fnd; did you mean find?"),
        (["db", "exprt", "all"], "no such command: exprt; did you mean export?"),
        (["edge", "--confg", "x"], "unknown option --confg; did you mean --config?"),
        (["run", "--intervall=3"], "unknown option --intervall; did you mean --interval?"),
        (["export", "all", "--out", "x", "--format", "parquett"], "did you mean parquet?"),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else "",
)
def test_a_misspelt_name_is_answered_with_the_nearest(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """One line, exit status 2."""
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("slipstream: ")
    assert said in line


def test_a_name_like_none_is_answered_with_all(capsys: pytest.CaptureFixture[str]) -> None:
    """No guess where none is near."""
    with pytest.raises(SystemExit):
        main(["xyzzy"])
    line = capsys.readouterr().err
    assert "did you mean" not in line
    assert "dispatcher" in line


def test_options_may_still_be_shortened(capsys: pytest.CaptureFixture[str]) -> None:
    """As argparse allows it, to the beginning of one name."""
    assert main(["net", "show", "--js"]) == 0
    assert '"segments": 22' in capsys.readouterr().out


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_is_a_script_that_knows_commands_and_options(
    shell: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The shell itself finds no fault in it, where it is installed."""
    assert main(["completion", shell]) == 0
    script = capsys.readouterr().out
    for word in ("dispatcher", "standby", "completion"):
        assert word in script
    if shutil.which(shell) is not None:
        path = tmp_path / "completion"
        path.write_text(script)
        subprocess.run([shell, "-n", str(path)], check=True, timeout=60)


@pytest.mark.process
def test_bash_completes_a_sub_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What the shell offers for `slipstream dispa`."""
    if shutil.which("bash") is None:
        pytest.skip("no bash")
    assert main(["completion", "bash"]) == 0
    path = tmp_path / "completion"
    path.write_text(capsys.readouterr().out)
    ask = (
        f". {path}; COMP_WORDS=(slipstream dispa); COMP_CWORD=1; "
        '_shtab_slipstream; printf "%s\\n" "${COMPREPLY[@]}"'
    )
    done = subprocess.run(
        ["bash", "-c", ask], capture_output=True, text=True, check=False, timeout=60
    )
    assert done.stdout.split() == ["dispatcher"], done.stderr


def test_a_value_may_begin_with_a_dash() -> None:
    """Southern latitudes, numbers below 0 and segments of SUMO nets, as option and as argument, of
    every sub-command.
    """
    top = parser()
    values = ("-16.846,-179.998", "-.5,3", "-E12", "-1002#3", "-1e-3", "-inf")
    for value in values:
        assert top.parse_args(["net", "find", value, "--net", "n.net.xml"]).query == value
        assert top.parse_args(["init", "folder", "--at", value]).at == value
    faults = [
        f"{command.prog} {value}"
        for command in parsers(top)
        for value in values
        if command._parse_optional(value) is not None
    ]
    assert faults == []


def test_a_short_option_that_is_none_is_still_refused(capsys: pytest.CaptureFixture[str]) -> None:
    """In one line; and help stays help."""
    with pytest.raises(SystemExit) as ended:
        main(["status", "-x"])
    assert ended.value.code == 2
    assert "-x" in capsys.readouterr().err
    with pytest.raises(SystemExit) as ended:
        main(["status", "-h"])
    assert ended.value.code == 0
