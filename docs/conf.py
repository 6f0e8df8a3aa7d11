"""Sphinx configuration: pages and notebooks in MyST markdown, executed while the site is built, offline.

python -m sphinx -W --keep-going docs docs/_build/html
"""

from __future__ import annotations

import hashlib
import os
import shutil
import sys
from pathlib import Path

DOCS = Path(__file__).resolve().parent
ROOT = DOCS.parent
sys.path.insert(0, str(DOCS))

# Notebooks run in kernels of their own, which inherit these.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ["COLUMNS"] = "96"
os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])  # `lgmpc` in cells

import lgmpc  # noqa: E402


def _sources() -> str:
    """Digest of the package's sources: outputs of notebooks are reused for these sources only."""
    digest = hashlib.sha256()
    for file in sorted((ROOT / "lgmpc").rglob("*")):
        if file.suffix in {".py", ".c", ".js", ".css", ".html"}:
            digest.update(file.read_bytes())
    for file in sorted((ROOT / "configs").rglob("*.yaml")):
        digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


OUTPUTS = DOCS / "_build" / "notebooks"
CACHE = OUTPUTS / _sources()
for old in OUTPUTS.glob("*"):
    if old != CACHE:
        shutil.rmtree(old, ignore_errors=True)

project = "lgmpc"
author = copyright = "lgmpc developers"
release = version = lgmpc.__version__

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "myst_nb",
    "reference_pages",
    "mathml",
]
exclude_patterns = ["_build", "**/.ipynb_checkpoints"]

html_theme = "furo"
html_title = f"lgmpc {release}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sphinx = False
html_theme_options = {"sidebar_hide_name": False, "navigation_with_keys": True}
pygments_style, pygments_dark_style = "friendly", "github-dark"

myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 3
nb_execution_mode = "cache"
nb_execution_cache_path = str(CACHE)
nb_execution_raise_on_error = True
nb_execution_in_temp = True
nb_execution_timeout = 300
nb_execution_show_tb = True
nb_merge_streams = True
nb_number_source_lines = False

linkcheck_timeout, linkcheck_retries = 20, 2
linkcheck_exclude_documents = ["reference/api/.*"]  # generated; they link to each other

autodoc_typehints_format = "short"
autodoc_type_aliases = {name: f"lgmpc.typing.{name}" for name in ("Array", "BoolArray")} | {"ArrayLike": "ArrayLike"}
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True, "show-inheritance": True}
autodoc_preserve_defaults = True
autosummary_generate = False
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False
napoleon_attr_annotations = False
python_maximum_signature_line_length = 90
python_use_unqualified_type_names = True
add_module_names = False
toc_object_entries_show_parents = "hide"
