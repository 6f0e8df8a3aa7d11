"""Check the built site: links lead to a page and a place on it, pictures have a text and a file, the search finds.

    python -m sphinx -W --keep-going docs docs/_build/html
    python scripts/check_site.py docs/_build/html

Links to other sites are checked for their form only, because this must work without a network; with one,
``python -m sphinx -b linkcheck docs docs/_build/links`` opens each of them once.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

from lgmpc.chromium import find_chromium

QUERY, FOUND = "FrictionCone", "lgmpc.costs.library"
"""A query of the search, and a result that it must have."""


@dataclass
class Page(HTMLParser):
    """The links of a page and the anchors on it."""

    links: list[str] = field(default_factory=list)
    pictures: list[tuple[str, str | None]] = field(default_factory=list)
    places: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        super().__init__()

    @classmethod
    def read(cls, file: Path) -> Page:
        """Return the content of a file."""
        page = cls()
        page.feed(file.read_text(encoding="utf-8"))
        return page

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Collect an element."""
        values = dict(attrs)
        self.places.update(value for name in ("id", "name") if (value := values.get(name)))
        if tag == "a" and (link := values.get("href")):
            self.links.append(link)
        if tag == "img":
            self.pictures.append((values.get("src") or "", values.get("alt")))


def faults(site: Path) -> Iterator[str]:
    """Yield the faults of a site's pages."""
    pages = {file.resolve(): Page.read(file) for file in sorted(site.rglob("*.html"))}
    for file, page in pages.items():
        name = file.relative_to(site.resolve())
        for link in page.links:
            fault = fault_of(link, file, pages)
            if fault:
                yield f"{name}: {link}: {fault}"
        for source, text in page.pictures:
            if not (text or "").strip() or (text or "").endswith((".png", ".svg")):  # Sphinx's own is the file's name
                yield f"{name}: {source[:60]}: a picture without a text (alt)"
            if not source.startswith("data:") and not (file.parent / unquote(source)).is_file():
                yield f"{name}: {source}: no such picture"


def fault_of(link: str, file: Path, pages: dict[Path, Page]) -> str:
    """Return the fault of a link on a page; empty if there is none."""
    parts = urlsplit(link)
    if parts.scheme:
        fine = parts.scheme == "mailto" or (
            parts.scheme in ("http", "https") and re.fullmatch(r"[\w-]+(\.[\w-]+)+", parts.netloc)
        )
        return "" if fine and not re.search(r"[\s<>{}]", link) else "not an address"
    target = (file.parent / unquote(parts.path)).resolve() if parts.path else file
    if target.suffix != ".html":
        return "" if target.is_file() else "no such file"
    if target not in pages:
        return "no such page"
    return "" if not parts.fragment or unquote(parts.fragment) in pages[target].places else "no such place on the page"


def search(site: Path, chromium: Path) -> str:
    """Return the text of the search's results, by a browser without a display."""
    address = f"{(site / 'search.html').resolve().as_uri()}?q={QUERY}"
    options = ("--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=20000", "--dump-dom")
    done = subprocess.run([chromium, *options, address], capture_output=True, text=True, timeout=120, check=True)
    return done.stdout.partition('id="search-results"')[2]


def main() -> None:
    """Print faults; exit with 1 if there are any."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("site", type=Path, help="folder of the built pages")
    site = parser.parse_args().site
    found = list(faults(site))
    chromium = find_chromium()
    if chromium is None:
        print("the search is not tried: no Chromium is installed")
    elif FOUND not in search(site, chromium):
        found.append(f"search.html: '{QUERY}' does not lead to {FOUND}")
    print(
        "\n".join(found)
        or f"{len(list(site.rglob('*.html')))} pages: all links lead somewhere, all pictures have a text"
    )
    sys.exit(bool(found))


if __name__ == "__main__":
    main()
