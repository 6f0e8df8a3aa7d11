"""Pages: one self-contained HTML text with viewer, scene, animation and time line; as file, in browser and notebooks.

A page works from ``file://`` without a network. :mod:`lgmpc.viz.scene` defines the encoding of its arrays.
"""

import base64
import html
import importlib.util
import os
import sys
import webbrowser
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import numpy as np

from lgmpc.errors import MissingDependencyError
from lgmpc.runs import atomic_write
from lgmpc.typing import Array
from lgmpc.viz.scene import Scene

_READOUT_COLORS = ("#0072b2", "#8a5a9e")
"""Colours of the first and the second curve on the time line."""

_FRAME_HEIGHT = 480  # px, in notebooks


@dataclass(frozen=True)
class Readout:
    """A quantity on the time line.

    Attributes:
        label: short name.
        unit: text after the number, with a leading space if required.
        values: (n,) one for each picture, not negative.
        digits: after the decimal point.
    """

    label: str
    unit: str
    values: Array
    digits: int = 2


def time_line(times: Array, readouts: tuple[Readout, ...], states: Sequence[str] = ()) -> dict[str, object]:
    """Return the data of the page's time line: at most two quantities over the pictures' times (n,), s.

    Args:
        times: (n,) times of the pictures, s.
        readouts: the quantities.
        states: (n,) name of the robot's mode, displayed beside them; empty for none.
    """
    curves = [
        {
            "label": readout.label,
            "unit": readout.unit,
            "digits": readout.digits,
            "color": color,
            "values": np.round(np.nan_to_num(readout.values), readout.digits + 1).tolist(),
        }
        for readout, color in zip(readouts, _READOUT_COLORS, strict=False)
    ]
    return {"time": np.round(times, 4).tolist(), "curves": curves, "states": list(states)}


def page_of(title: str, scene: Scene, content: Mapping[str, object]) -> str:
    """Return the page's HTML.

    Args:
        title: title of the window.
        scene: the scene.
        content: of the panels: name, created, verdict, reasons, facts, legend, pushes, start, series (see
            :func:`time_line`), fog, camera.

    Raises:
        MissingDependencyError: if meshcat is not installed.
    """
    viewer = _viewer_folder()
    assets = resources.files("lgmpc.viz") / "assets"
    parts = {
        "title": html.escape(title),
        "licences": _licences(viewer),
        "style": (assets / "replay.css").read_text(encoding="utf-8"),
        # This sequence would end the script element.
        "viewer": (viewer / "dist" / "main.min.js").read_text(encoding="utf-8").replace("</script", "<\\/script"),
        "payload": base64.b64encode(scene.pack(content)).decode("ascii"),
        "script": (assets / "replay.js").read_text(encoding="utf-8"),
    }
    return filled((assets / "replay.html").read_text(encoding="utf-8"), parts)


def filled(template: str, parts: Mapping[str, str]) -> str:
    """Return the template with each ``@@name@@`` replaced by the part of that name."""
    page, *rest = template.split("@@")
    for name, text in zip(rest[::2], rest[1::2], strict=True):
        page += parts[name] + text
    return page


def write_page(page: str, file: Path | str) -> Path:
    """Write a page to a file, atomically, and return the file's path.

    Raises:
        RunFolderError: if the file cannot be written.
    """
    path = Path(file)
    with atomic_write(path) as stream:
        stream.write(page.encode("utf-8"))
    return path


def frame_of(page: str, height: int = _FRAME_HEIGHT) -> str:
    """Return the HTML of a frame that contains a page.

    Args:
        page: the page's HTML.
        height: px; the frame is as wide as the notebook.
    """
    style = f"width:100%;height:{height}px;border:0;border-radius:6px"
    frame = f'<iframe srcdoc="{html.escape(page)}" style="{style}" loading="lazy" title="replay"></iframe>'
    return f"<div>{frame}</div>"  # IPython warns about HTML that begins with a frame


def embed_page(page: str, height: int = _FRAME_HEIGHT) -> None:
    """Display a page as an output of the notebook's cell; arguments as in :func:`frame_of`."""
    from IPython.display import HTML, display

    display(HTML(frame_of(page, height)))  # type: ignore[no-untyped-call]


def in_notebook() -> bool:
    """Return whether this process is the kernel of a notebook, whose outputs can be HTML."""
    # IPython is not imported for that: in a kernel it has been, and elsewhere it need not be installed.
    ipython = sys.modules.get("IPython")
    return ipython is not None and hasattr(ipython.get_ipython(), "kernel")


def open_page(page: Path | str) -> None:
    """Open a page, a file or an address, in the default browser, if there is a desktop."""
    if sys.platform != "linux" or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        webbrowser.open(page if isinstance(page, str) else page.resolve().as_uri())


def _viewer_folder() -> Path:
    # Located, not imported: meshcat's Python package imports sockets and notebooks that a page does not need.
    spec = importlib.util.find_spec("meshcat")
    if spec is None or not spec.submodule_search_locations:
        raise MissingDependencyError("meshcat", "the replay", "pip install meshcat")
    return Path(spec.submodule_search_locations[0]) / "viewer"


def _licences(viewer: Path) -> str:
    files = (viewer / "LICENSE", viewer / "dist" / "main.min.js.LICENSE.txt")
    texts = [file.read_text(encoding="utf-8") for file in files if file.is_file()]
    return "\n".join(texts).replace("--", "- -")
