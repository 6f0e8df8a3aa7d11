"""Common parts of all figures: style, titles, legends, limits; their files and their display in notebooks."""

import io
import re
from base64 import b64encode
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lgmpc.errors import MissingDependencyError, RunFolderError
from lgmpc.runs import RunResult, SolveResult, atomic_write
from lgmpc.runs.atomic import reason_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

X, Y, Z = "#0072B2", "#E69F00", "#009E73"  # Okabe and Ito's palette, distinguishable by colour-blind readers
LIMIT, PUSH, EXTRA = "#D55E00", "#D55E00", "#CC79A7"
INK, SOFT = "#1d2733", "#5b6877"
PALETTE = (X, Y, Z, LIMIT, EXTRA, "#56B4E9")
"""Colours of further curves, in order."""

THEMED = {INK: "ink", SOFT: "soft", "#b9c2cc": "line", "#e6eaee": "grid"}
"""Colours that a page replaces by CSS variables, and the names of these."""

_VECTOR: dict[Any, Any] = {"svg.fonttype": "none", "path.simplify_threshold": 0.1, "figure.dpi": 72}

_STYLE: dict[Any, Any] = {
    "figure.dpi": 130,
    "figure.facecolor": "white",
    "font.size": 10,
    "text.color": INK,
    "axes.edgecolor": "#b9c2cc",
    "axes.labelcolor": INK,
    "axes.titlesize": 10.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,  # stairs are patches, over which the grid would be drawn
    "grid.color": "#e6eaee",
    "xtick.color": SOFT,
    "ytick.color": SOFT,
    "lines.linewidth": 1.4,
    "legend.frameon": False,
    "legend.fontsize": 9,
}


@contextmanager
def figure_maker(purpose: str, *, vector: bool = False) -> "Iterator[Callable[[], Figure]]":
    """Yield a function that creates empty figures, without a display and in the common style.

    Args:
        purpose: purpose of the figures, for the error message.
        vector: whether they are saved as vectors, with text as text.

    Raises:
        MissingDependencyError: if matplotlib is not installed.
    """
    try:
        import matplotlib
        from matplotlib.figure import Figure
    except ImportError as error:
        raise MissingDependencyError("matplotlib", purpose, "pip install matplotlib") from error

    class Picture(Figure):  # which a notebook displays, with or without pyplot
        def _repr_png_(self) -> bytes:
            return _png(self)

    with matplotlib.rc_context(_STYLE | _VECTOR if vector else _STYLE):
        yield lambda: Picture(layout="constrained")


def _png(figure: "Figure") -> bytes:
    """Return the content of a PNG file. It is drawn once; ``savefig`` draws twice when the layout is constrained."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    stream = io.BytesIO()
    FigureCanvasAgg(figure).print_png(stream)  # type: ignore[no-untyped-call]
    return stream.getvalue()


Drawing = Callable[["Figure"], bool]
"""Draws on an empty figure and returns whether there was data."""


class Plots(dict[str, "Figure"]):
    """Figures of matplotlib by name. A notebook displays all of them, or one that is looked up.

    Attributes:
        title: title of the run or trajectory.
    """

    def __init__(self, figures: "Mapping[str, Figure]", title: str) -> None:
        super().__init__(figures)
        self.title = title

    def save(self, folder: str | Path) -> tuple[Path, ...]:
        """Write each figure as ``<name>.png`` and return the files.

        Args:
            folder: of the files; created if it does not exist.

        Raises:
            RunFolderError: if the folder cannot be written.
        """
        folder = Path(folder)
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RunFolderError(f"cannot create {folder}: {reason_of(error)}") from error
        for name, figure in self.items():
            with atomic_write(folder / f"{name}.png") as file:
                file.write(_png(figure))
        return tuple(folder / f"{name}.png" for name in self)

    def _repr_html_(self) -> str:
        """Return the figures as pictures."""
        return "".join(_embedded(figure, f"{name}: {self.title}") for name, figure in self.items())


def _embedded(figure: "Figure", text: str) -> str:
    data = b64encode(_png(figure)).decode()
    return f'<img src="data:image/png;base64,{data}" alt="{escape(text)}" style="max-width:100%"><br>'


def draw_figures(drawings: Mapping[str, Drawing], title: str) -> Plots:
    """Draw figures.

    Args:
        drawings: name -> drawing.
        title: of the run, in the title of every figure.

    Returns:
        Those with data.

    Raises:
        MissingDependencyError: if matplotlib is not installed.
    """
    drawn = {}
    for name, figure in _drawn("lgmpc plot", drawings):
        figure.suptitle(f"{figure_heading(name)} · {title}", x=0.01, ha="left", fontsize=9, color=SOFT)
        figure.draw_without_rendering()  # ticks are created when drawn, in the style active then
        drawn[name] = figure
    return Plots(drawn, title)


def _drawn(purpose: str, drawings: Mapping[str, Drawing], *, vector: bool = False) -> "Iterator[tuple[str, Figure]]":
    """Yield name and figure of the drawings with data, in the common style while it is used."""
    with figure_maker(purpose, vector=vector) as make:
        for name, draw in drawings.items():
            figure = make()
            if draw(figure):
                yield name, figure


def svg_figures(drawings: Mapping[str, Drawing]) -> dict[str, str]:
    """Draw figures as SVG elements for a page, with the page's colours and fonts.

    Args:
        drawings: name -> drawing.

    Returns:
        Name -> text of the element. Ink, lines and grid have the CSS variables ``--ink``, ``--soft``, ``--line`` and
        ``--grid`` as colours, so that they suit light and dark pages.

    Raises:
        MissingDependencyError: if matplotlib is not installed.
    """
    drawn = {}
    for name, figure in _drawn("lgmpc report", drawings, vector=True):
        stream = io.StringIO()
        figure.savefig(stream, format="svg", transparent=True, metadata={"Date": None})
        drawn[name] = _for_page(stream.getvalue())
    return drawn


def _for_page(svg: str) -> str:
    """Return the element of an SVG file: in the page's colours, without a size, and without ids that nothing uses."""
    element = svg[svg.index("<svg") :]
    element = re.sub(r"<metadata>.*?</metadata>", "", element, flags=re.DOTALL)
    element = re.sub(r'^(<svg[^>]*?) width="[^"]*"', r"\1", element)
    element = re.sub(r'^(<svg[^>]*?) height="[^"]*"', r"\1", element)
    element = re.sub(r'<g id="[^"]*"', "<g", element)
    # Coordinates are rounded to a hundredth of a point, which is invisible.
    element = re.sub(r' (?:d|x|y|transform)="[^"]+"', lambda match: re.sub(r"(\.\d\d)\d+", r"\1", match[0]), element)
    element = re.sub(r"font-family: [^;\"]*;? ?", "", element)
    for color, variable in THEMED.items():
        element = element.replace(color, f"var(--{variable})")
    return element


def figure_heading(name: str) -> str:
    """Return the heading of a figure: of ``torques`` "Torques"."""
    return {"com": "Centre of mass"}.get(name, name.capitalize().replace("_", " "))


def figure_title(result: RunResult | SolveResult) -> str:
    """Return name, verdict and time of a run."""
    return f"{result.name} · {result.verdict.outcome.value} · {result.when}"


def legend_above(*all_axes: "Axes") -> None:
    """Place the legend of each axes above its right end."""
    for axes in all_axes:
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, borderaxespad=0.1, handlelength=1.4)
