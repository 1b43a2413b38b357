"""The command line's parser: faults in one line with the nearest name, help with all defaults."""

from __future__ import annotations

import argparse
import difflib
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final, NoReturn

EXIT_BAD_INPUT: Final = 2
_WIDTH: Final = 79


def nearest(word: str, known: Iterable[str]) -> str:
    """Which known name is meant, as the end of a sentence; "" where none is near."""
    found = difflib.get_close_matches(word, list(known), n=1, cutoff=0.6)
    return f"; did you mean {found[0]}?" if found else ""


class _Formatter(argparse.HelpFormatter):
    """Adds the default of each option that takes a value and need not be given."""

    def _get_help_string(self, action: argparse.Action) -> str:
        text = action.help or ""
        may_lack = action.nargs in ("?", "*") if not action.option_strings else not action.required
        if not may_lack or action.nargs == 0 or "default" in text:
            return text
        default = action.default
        if isinstance(default, list | tuple):
            default = " ".join(map(str, default))
        shown = "none" if default is None or default == "" else str(default).replace("%", "%%")
        return f"{text.removesuffix('.')} (default: {shown})"


if TYPE_CHECKING:
    _Action = argparse._SubParsersAction[argparse.ArgumentParser]
else:  # it takes no parameter when it runs
    _Action = argparse._SubParsersAction


class _Commands(_Action):
    """Sub-commands whose own help begins with what the list of all says of them."""

    def add_parser(self, name: str, **options: Any) -> argparse.ArgumentParser:
        summary = options.get("help")
        if summary:
            sentence = f"{summary[0].upper()}{summary[1:]}"
            options.setdefault("description", sentence + ("" if sentence.endswith("?") else "."))
        return super().add_parser(name, **options)

    @property
    def summaries(self) -> dict[str, str]:
        """What each sub-command does, in the order in which they were added."""
        return {action.dest: action.help or "" for action in self._choices_actions}


class Parser(argparse.ArgumentParser):
    """Says what is wrong with the command line in one line, as for all bad input.

    Args:
        groups: sub-commands by heading, for a help that lists them so; None: argparse's help.
        more: what is said of further sub-commands where one is not known.
    """

    def __init__(
        self,
        *args: Any,
        groups: Mapping[str, Sequence[str]] | None = None,
        more: str = "",
        **options: Any,
    ) -> None:
        options.setdefault("formatter_class", _Formatter)
        super().__init__(*args, **options)
        self.register("action", "parsers", _Commands)
        self._groups, self._more = groups, more

    def error(self, message: str) -> NoReturn:
        """End with the fault in one line."""
        self.exit(EXIT_BAD_INPUT, f"slipstream: {message}; see {self.prog} --help\n")

    def format_help(self) -> str:
        """The help; with groups, one line a sub-command under their headings."""
        if self._groups is None:
            return super().format_help()
        commands = next(a for a in self._actions if isinstance(a, _Commands)).summaries
        width = max(map(len, commands)) + 4
        lines = [
            f"usage: {self.prog} [-h] [--version] COMMAND ...  ({self.prog} COMMAND --help)",
            "",
        ]
        lines += [*textwrap.wrap(self.description or "", _WIDTH), ""]
        for title, names in self._groups.items():
            lines += [f"{title}:"]
            for name in names:
                text = textwrap.shorten(commands[name], _WIDTH - width, placeholder=" ...")
                lines += [f"  {name:<{width - 2}}{text}"]
        return "\n".join([*lines, "", self.epilog or ""]) + "\n"

    def parse_known_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: argparse.Namespace | None = None
    ) -> tuple[argparse.Namespace, list[str]]:
        """Parse; an option that is not known is told before one that is missing."""
        if args is not None and not any(isinstance(a, _Commands) for a in self._actions):
            self._refuse_unknown(args)
        return super().parse_known_args(args, namespace)

    def _parse_optional(self, arg_string: str) -> Any:
        """As argparse; but a word with one dash that is no option is a value: a southern
        latitude, a segment of a SUMO net, a number with an exponent.
        """
        is_option = arg_string[1:2] == "-" or arg_string[:2] in self._option_string_actions
        if arg_string[:1] == "-" and not is_option:
            return None
        return super()._parse_optional(arg_string)

    def _refuse_unknown(self, args: Sequence[str]) -> None:
        known = [name for name in self._option_string_actions if name.startswith("--")]
        for word in args:
            if word == "--":
                return
            name = word.partition("=")[0]
            if name.startswith("--") and not any(option.startswith(name) for option in known):
                self.error(f"unknown option {name}{nearest(name, known)}")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is None or value in action.choices:
            return
        known = [str(choice) for choice in action.choices]
        if isinstance(action, _Commands):
            hint = nearest(str(value), known) or f"; there are {', '.join(known)}"
            self.error(f"no such command: {value}{hint}{self._more}")
        raise argparse.ArgumentError(
            action, f"{value!r} is none of {', '.join(known)}{nearest(str(value), known)}"
        )
