"""Settings of Sphinx for the site that `make docs` builds."""

import os
import re
import sys
from dataclasses import is_dataclass
from types import ModuleType

from docutils import nodes
from sphinx import addnodes

import thalweg

project = "Thalweg"
author = "The Thalweg authors"
copyright = "The Thalweg authors"
version = release = thalweg.__version__
root_doc = "index"
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "sphinx_design",
]

myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 5  # links to headings, as git hosts make them
default_role = "py:obj"  # docstrings name objects in single backquotes
napoleon_google_docstring = True
napoleon_numpy_docstring = False
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_default_options = {"members": True, "imported-members": True}
autodoc_preserve_defaults = True
autodoc_mock_imports = ["pufferlib", "stable_baselines3"]  # adapters import what is not installed here
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 100
toc_object_entries_show_parents = "hide"

html_theme = "pydata_sphinx_theme"
html_title = "Thalweg"
html_baseurl = os.environ.get("THALWEG_SITE_URL", "")  # address at which the site will be served
html_static_path = ["static"]  # beside this file
html_css_files = ["site.css"]
html_js_files = ["sortable.js"]
html_copy_source = False
html_show_sourcelink = False
html_sidebars = {"index": [], "docs/leaderboard": [], "docs/glossary": []}
html_theme_options = {
    "logo": {"text": "Thalweg"},
    "header_links_before_dropdown": 6,
    "navigation_with_keys": False,
    "show_prev_next": True,
    "secondary_sidebar_items": {"**": ["page-toc"], "index": [], "docs/leaderboard": []},
    "footer_start": ["copyright"],
    "footer_end": [],
    "show_version_warning_banner": False,
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}


def stand_in(name, **members):
    """Let a module be imported that is not installed here, with the members that a module of the package needs."""
    sys.modules[name] = module = ModuleType(name)
    vars(module).update(members)


stand_in("omnisafe")  # the mock of autodoc takes the place of the class that its decorator registers
stand_in("omnisafe.envs")
stand_in("omnisafe.envs.core", CMDP=object, env_register=lambda env: env, support_envs=list)


def shorten_signature(app, what, name, obj, options, signature, return_annotation):
    """Leave the fields of dataclasses out of signatures, since each follows with its type and docstring."""
    return ("(...)", "") if what == "class" and is_dataclass(obj) else None


def shorten_type(app, domain, objtype, contentnode):
    """Show the type of a field without its limits."""
    if objtype not in ("attribute", "data"):
        return
    for part in contentnode.parent.findall(addnodes.desc_annotation):
        if "Annotated[" in part.astext() or "PydanticUndefined" in part.astext():
            shown = re.sub(r"\b(\w+)\1\b", r"\1", part.astext())  # a reference holds its long and its short name
            kept = re.search(r"Annotated\[(.+?), (?:FieldInfo|~?pydantic|\w+\()", shown)
            part.clear()
            part += nodes.Text(f": {kept[1]}" if kept else "")


def keep_colons(app, what, name, obj, options, lines):
    """Begin docstrings of fields with an empty comment, or Napoleon takes what comes before a colon for a type."""
    if what in ("attribute", "data", "property"):
        lines[:0] = ["..", ""]


def setup(app):
    """Connect the functions above to Sphinx."""
    app.connect("autodoc-process-docstring", keep_colons, priority=400)  # before Napoleon
    app.connect("autodoc-process-signature", shorten_signature)
    app.connect("object-description-transform", shorten_type)
