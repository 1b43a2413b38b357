"""Links between the repository's Markdown files lead somewhere."""

from __future__ import annotations

import os
import re
from collections import Counter
from functools import cache
from pathlib import Path
from urllib.parse import unquote

import pytest

ROOT = Path(__file__).parents[2]
_NO_PAGES = ("build", "dist", "node_modules")


def pages(root: Path) -> list[Path]:
    """All Markdown files below a folder, those of hidden and generated folders left out."""
    found = []
    for folder, folders, files in os.walk(root):
        folders[:] = [f for f in folders if not f.startswith(".") and f not in _NO_PAGES]
        found += [Path(folder) / name for name in files if name.endswith(".md")]
    return sorted(found)


PAGES = pages(ROOT)

_FENCE = re.compile(r"^(```|~~~).*?^\1", re.MULTILINE | re.DOTALL)
_CODE = re.compile(r"`[^`\n]*`")
_LINK = re.compile(r"\[[^\]]*\]\(<?([^()\s>]+(?:\([^()\s]*\))?[^()\s>]*)>?(?:\s+\"[^\"]*\")?\)")
_HEADING = re.compile(r"^#{1,6}\s+(.+?)\s*#*\s*$", re.MULTILINE)
_NAMED = re.compile(r"<a\s+(?:id|name)=\"([^\"]+)\"")
_ELSEWHERE = ("http://", "https://", "mailto:")


def links(text: str) -> list[str]:
    """Targets of a page's links and pictures, those within code left out."""
    return _LINK.findall(_CODE.sub("code", _FENCE.sub("", text)))


def anchors(text: str) -> set[str]:
    """The anchors that GitHub gives to a page's headings, and those named in HTML."""
    found = set(_NAMED.findall(text))
    seen: Counter[str] = Counter()
    for heading in _HEADING.findall(_FENCE.sub("", text)):
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).replace("`", "").lower()
        slug = re.sub(r"[^\w\- ]", "", plain).replace(" ", "-")
        found.add(f"{slug}-{seen[slug]}" if seen[slug] else slug)
        seen[slug] += 1
    return found


@cache
def anchors_of(page: Path) -> set[str]:
    """The anchors of a page, read once."""
    return anchors(page.read_text(encoding="utf-8"))


def dead_links(page: Path) -> list[str]:
    """Relative links of a page whose file or anchor is missing."""
    dead = []
    for link in links(page.read_text(encoding="utf-8")):
        if link.startswith(_ELSEWHERE):
            continue
        path, _, anchor = unquote(link).partition("#")
        target = (page.parent / path).resolve() if path else page
        missing = anchor and target.suffix == ".md" and target.exists()
        if not target.exists() or (missing and anchor not in anchors_of(target)):
            dead.append(link)
    return dead


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_relative_links_and_anchors_resolve(page: Path) -> None:
    """Every relative link names a file that exists, and every anchor a heading of it."""
    assert dead_links(page) == []


def test_the_pages_are_found() -> None:
    """The walk sees the pages that readers start from."""
    names = {str(page.relative_to(ROOT)) for page in PAGES}
    assert {"README.md", "CONTRIBUTING.md", "docs/architecture.md", "docs/results.md"} <= names


def test_a_dead_link_is_seen(tmp_path: Path) -> None:
    """A missing file and a missing anchor are both reported; code and the web are not looked at."""
    (tmp_path / "other.md").write_text("# One `two`: three\n\n# Again\n\n# Again\n")
    page = tmp_path / "page.md"
    page.write_text(
        "# Here\n[a](other.md#one-two-three) [b](other.md#again-1) [c](#here) [d](https://x.example)\n"
        "`[e](none.md)` [f](gone.md) [g](other.md#four) ![h](gone.png) [i](#there)\n"
    )
    assert dead_links(page) == ["gone.md", "other.md#four", "gone.png", "#there"]
