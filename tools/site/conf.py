"""Sphinx's settings for the site. Nothing is loaded from outside, neither to build nor to read it."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import fastibl  # noqa: E402

project = "fastibl"
version = release = fastibl.__version__
copyright = "the fastibl authors"
html_title = f"fastibl {version}"
html_theme = "furo"
html_static_path = [str(Path(__file__).parent / "static")]
html_css_files = ["site.css"]
html_copy_source = html_show_sourcelink = False
html_theme_options = {"footer_icons": [], "top_of_page_buttons": []}

extensions = ["myst_parser", "sphinx.ext.autodoc", "docstrings"]
myst_heading_anchors = 3
suppress_warnings = ["myst.header"]  # the changelog begins at a second level

autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
python_maximum_signature_line_length = 88
python_use_unqualified_type_names = True
add_module_names = False
