"""The page's own files: whole, compressed for who takes it, not sent twice."""

from __future__ import annotations

import gzip
import re

from dashboard.web.app import STATIC
from tests.dashboard.web.browser import TABS


def test_each_file_is_served_as_it_is(serve):
    """Packed or not, with its kind; the page itself at the root."""
    page = serve()
    index = (STATIC / "index.html").read_bytes()
    assert page.get("/").body == page.get("/static/index.html").body == index
    for name, kind in (
        ("main.js", "javascript"),
        ("map/map.css", "text/css"),
        ("favicon.svg", "image/svg+xml"),
    ):
        plain = page.get(f"/static/{name}")
        packed = page.get(f"/static/{name}", accept_encoding="gzip, br")
        assert plain.body == (STATIC / name).read_bytes()
        assert plain.body in (packed.body, _unpacked(packed))
        assert len(packed.body) <= len(plain.body)
        assert kind in plain.headers["content-type"]
        assert plain.headers["cache-control"] == "no-cache"
    assert page.get("/static/main.js", accept_encoding="gzip").headers["content-encoding"] == "gzip"


def test_a_file_that_is_known_is_not_sent_again(serve):
    """By its ETag; another one, HEAD and no file at all are answered as HTTP says."""
    page = serve()
    tag = page.get("/static/main.js").headers["etag"]
    assert tag != page.get("/static/api.js").headers["etag"]
    known = page.get("/static/main.js", if_none_match=f'"other", W/{tag}')
    assert (known.status, known.body) == (304, b"")
    assert page.get("/static/main.js", if_none_match='"other"').status == 200
    head = page.ask("HEAD", "/static/main.js")
    assert (head.status, head.body, head.headers["etag"]) == (200, b"", tag)
    assert page.get("/static/none.js").status == 404
    assert page.get("/static/").status == 404
    assert page.ask("POST", "/static/main.js").status == 405


def _unpacked(answer):
    return gzip.decompress(answer.body) if "content-encoding" in answer.headers else answer.body


def test_the_page_names_all_its_modules_beforehand():
    """Else a browser would find them one after the other, a round trip each."""
    text = (STATIC / "index.html").read_text()
    named = re.findall(r'<link rel="modulepreload" href="static/(.+?)"', text)
    there = [str(path.relative_to(STATIC)) for path in STATIC.rglob("*.js")]
    assert sorted(named) == sorted(set(there) - {"theme.js", "main.js"})
    assert set(TABS) == set(re.findall(r'id="pane-(\w+)"', text))
