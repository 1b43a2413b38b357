"""`slipstream completion`: a script that completes commands, options and files in a shell."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Final

_SHELLS: Final = ("bash", "zsh", "fish")


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser(
        "completion",
        help="a script for the shell that completes commands and options",
        description="Prints the script. bash: slipstream completion bash > "
        "~/.local/share/bash-completion/completions/slipstream; zsh: > a folder of $fpath, as "
        "_slipstream; fish: > ~/.config/fish/completions/slipstream.fish.",
    )
    command.add_argument("shell", choices=_SHELLS, help="which shell")
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Print the script."""
    import shtab

    from slipstream_cli.main import parser

    top = parser()
    _complete_files(top)
    print(shtab.complete(top, shell=options.shell))
    return 0


def _complete_files(parser: argparse.ArgumentParser) -> None:
    """Have values that are paths completed with the names of files."""
    import shtab

    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for command in dict.fromkeys(action.choices.values()):
                _complete_files(command)
        elif action.type is Path:
            action.complete = shtab.FILE  # type: ignore[attr-defined]
