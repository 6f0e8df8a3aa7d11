r"""Make a picture of several replays side by side, from pages that `lgmpc play RUN --html` and `lgmpc demo` write.

    python scripts/make_gallery_picture.py .assets/gallery.png --columns 3 \
        "jump.html@0.42=Solo12 jumps" "iris.html@1.3=Iris flies a loop"

Needs playwright (``pip install -e ".[test]"``) and a Chromium.
"""

from __future__ import annotations

import argparse
import base64
import html
import re
import sys
from dataclasses import dataclass
from pathlib import Path

from snapshot import headless_chromium, snapshots

from lgmpc.errors import InputError, LgmpcError
from lgmpc.runs import atomic_write

PANEL = (480, 330)
GAP = 4
PAGE = """<!DOCTYPE html><meta charset="utf-8"><style>
body {{ margin: 0; display: grid; grid-template-columns: repeat({columns}, {width}px); gap: {gap}px; background: #fff;
  font: 17px system-ui, "DejaVu Sans", sans-serif; }}
figure {{ margin: 0; position: relative; }}
img {{ display: block; width: 100%; border-radius: 8px; }}
figcaption {{ position: absolute; left: 16px; bottom: 12px; color: #1d2733; }}
</style>{figures}"""


@dataclass(frozen=True)
class View:
    """A moment of a replay, and what to say about it."""

    page: Path
    time: float
    caption: str

    @classmethod
    def parse(cls, text: str) -> View:
        """Read ``PAGE@SECONDS=CAPTION``.

        Raises:
            InputError: another form, or no such page.
        """
        found = re.fullmatch(r"(.+)@([0-9.]+)=(.+)", text)
        if not found:
            raise InputError("view", text, "PAGE.html@SECONDS=CAPTION")
        page = Path(found[1])
        if not page.is_file():
            raise InputError("page", page, "a page that `lgmpc play RUN --html FILE` wrote")
        return cls(page, float(found[2]), found[3])


def main() -> int:
    """Run the script."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("picture", type=Path, help="PNG to write")
    parser.add_argument("views", nargs="+", metavar="PAGE@SECONDS=CAPTION", help="what to show")
    parser.add_argument("--columns", type=int, default=3, help="pictures in a row")
    arguments = parser.parse_args()
    try:
        picture = draw([View.parse(text) for text in arguments.views], arguments.columns)
        arguments.picture.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(arguments.picture) as file:
            file.write(picture)
    except LgmpcError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    print(f"wrote {arguments.picture}")
    return 0


def draw(views: list[View], columns: int) -> bytes:
    """Return the PNG: all views in rows of ``columns``, each with its caption."""
    with headless_chromium() as browser:
        pictures = [snapshots(browser, view.page, [view.time], size=PANEL, panels=False)[0] for view in views]
        figures = "".join(
            f'<figure><img src="data:image/png;base64,{base64.b64encode(picture).decode()}">'
            f"<figcaption>{html.escape(view.caption)}</figcaption></figure>"
            for picture, view in zip(pictures, views, strict=True)
        )
        rows = -(-len(views) // columns)
        size = {"width": columns * (PANEL[0] + GAP) - GAP, "height": rows * (PANEL[1] + GAP) - GAP}
        tab = browser.new_page(viewport=size)
        tab.set_content(PAGE.format(columns=columns, width=PANEL[0], gap=GAP, figures=figures))
        tab.evaluate("Promise.all([...document.images].map(image => image.decode()))")
        return tab.screenshot()


if __name__ == "__main__":
    sys.exit(main())
