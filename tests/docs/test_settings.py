"""docs/settings.md shows every setting, with its meaning."""

from __future__ import annotations

from pathlib import Path

import pytest
from pydantic import Field

from slipstream.config import Settings
from slipstream_cli.settings_doc import DAEMONS, page, sections, site_sections

PAGE = Path(__file__).parents[2] / "docs" / "settings.md"


def test_the_committed_page_is_what_the_models_give() -> None:
    """A change of a setting changes the page: `make settings-doc`."""
    assert PAGE.read_text(encoding="utf-8") == page()


@pytest.mark.parametrize("daemon", DAEMONS)
def test_every_setting_has_a_description(daemon: str) -> None:
    """No key is left to be guessed from its name."""
    keys = [key for section in sections(DAEMONS[daemon]) for key in section.keys]
    assert [key.path for key in keys if not key.description] == []


@pytest.mark.parametrize("daemon", DAEMONS)
def test_every_description_stands_alone(daemon: str) -> None:
    """A description begins and ends its own sentence: none goes on in the next key's."""
    keys = [key for section in sections(DAEMONS[daemon]) for key in section.keys]
    split = [
        key.path
        for key in keys
        if key.description
        and (not key.description.endswith((".", "?", ")")) or "..." in key.description)
    ]
    assert split == []


def test_type_default_bounds_and_former_name_are_shown() -> None:
    """All that a model says of a key is on the page."""

    class Inner(Settings):
        """A section."""

        share: float = Field(default=0.5, gt=0, lt=1, description="A share.")

    class Outer(Settings):
        """The top."""

        max_jobs: int | None = Field(default=None, ge=1, description="Jobs.")
        names: tuple[str, ...] = Field(default=("a", "b"), min_length=1, description="Names.")
        path: Path = Field(description="A path.")
        inner: Inner = Inner(share=0.25)

    top, inner = sections(Outer)
    jobs, names, path = top.keys
    assert (jobs.type, jobs.default, jobs.bounds) == ("integer", "–", "≥ 1")
    assert (names.type, names.default) == ("list of text", '`["a", "b"]`')
    assert names.bounds == "entries ≥ 1"
    assert (path.type, path.default) == ("path", "required")
    assert inner.path == "inner"
    assert (inner.keys[0].path, inner.keys[0].default) == ("inner.share", "`0.25`")
    assert inner.keys[0].bounds == "> 0, < 1"


def test_an_operator_has_few_keys_to_know() -> None:
    """Each key of the file once, whichever daemons read it."""
    keys = [key.path for section in site_sections() for key in section.keys]
    assert len(set(keys)) == len(keys)
    assert len(keys) <= 120
