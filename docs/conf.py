"""The documentation: `sphinx-build -W --keep-going -b html docs OUT`. Nothing is fetched, and nothing long is run."""

import shutil
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

sys.path.insert(0, str(Path(__file__).parent / "_extensions"))

from auroraqd import __version__

project = "auroraqd"
author = "the auroraqd authors"
copyright = f"2026, {author}"
release = version = __version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "sphinx_design",
    "command_line",
]
exclude_patterns = ["_extensions"]

# Pages
myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 3
myst_links_external_new_tab = False

# The API, from docstrings
default_role = "py:obj"  # a name in single quotes is a link where it is known, and else code
autosummary_generate = False  # tables of links; what they lead to is on the same page
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
autodoc_class_signature = "mixed"
autodoc_preserve_defaults = True
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_custom_sections = [("Warns", "returns_style")]

suppress_warnings = ["ref.python"]  # of `n_genes`, which many have, any will do

# What it looks like
html_theme = "pydata_sphinx_theme"
html_title = f"auroraqd {release}"
html_favicon = "_static/logo.svg"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "logo": {"image_light": "_static/logo.svg", "image_dark": "_static/logo.svg", "text": "auroraqd", "alt_text": "auroraqd"},
    "navbar_align": "left",
    "navbar_end": ["theme-switcher"],
    "navbar_persistent": ["search-button"],
    "header_links_before_dropdown": 6,
    "show_toc_level": 2,
    "navigation_with_keys": False,
    "show_prev_next": True,
    "footer_start": ["copyright"],
    "footer_end": [],
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}
html_sidebars = {"index": []}
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True


def setup(app):
    """Write the report on the paper's claims, with its figures, beside the page that has its tables."""

    def report(app, error):
        from auroraqd.experiments.ledger import Ledger
        from auroraqd.report import write_paper

        if error is None and app.builder.name == "html":
            results = Path(__file__).parents[1] / "results"
            ledgers = {task: Ledger(results / task) for task in ("ballistic", "air-hockey")}
            with TemporaryDirectory() as folder:
                for path in write_paper(ledgers, folder):
                    if path.suffix != ".md":
                        shutil.copy(path, Path(app.outdir, "results", f"paper_report{path.suffix}"))

    app.connect("build-finished", report)
