"""The site: `make docs`. Nothing here or in the pages asks the network."""

import shutil
import sys
from pathlib import Path
from typing import Any

import msgspec
from sphinx.application import Sphinx
from sphinx.ext.napoleon.docstring import GoogleDocstring

DOCS = Path(__file__).parent
ROOT = DOCS.parent
sys.path[:0] = [str(ROOT), str(DOCS)]

from sphinx_gallery.scrapers import figure_rst  # noqa: E402

from haptigraph.version import __version__  # noqa: E402

project = "haptigraph"
author = "The haptigraph developers"
project_copyright = f"2026, {author}"
version = release = __version__

extensions = [
    "generated",
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = [
    "sg_execution_times.rst",
    "**/sg_execution_times.rst",
    "gallery/*.ipynb",
    "gallery/*.json",
]

myst_enable_extensions = ["colon_fence", "deflist", "substitution", "attrs_inline"]
myst_heading_anchors = 4
myst_links_external_new_tab = True

# Notebooks and their files live in examples/; pages need them below docs/.
shutil.copytree(ROOT / "examples" / "notebooks", DOCS / "notebooks", dirs_exist_ok=True)
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 300
nb_ipywidgets_js: dict = {}  # widgets would be loaded from a CDN
nb_merge_streams = True

autodoc_typehints = "signature"
maximum_signature_line_length = 90
default_role = "py:obj"  # `names` in docstrings: code, and links where the site has them
autodoc_typehints_format = "short"
autodoc_member_order = "bysource"
napoleon_numpy_docstring = False
add_module_names = False
toc_object_entries_show_parents = "hide"


def written_figures(block: tuple, block_vars: dict, gallery_conf: dict) -> str:
    """Show the figures that a program of the gallery has written beside it."""
    written = sorted(
        path for ending in ("png", "svg") for path in Path(block_vars["src_file"]).parent.glob(f"*.{ending}")
    )
    shown = []
    for path, name in zip(written, block_vars["image_path_iterator"], strict=False):
        shown.append(str(Path(name).with_suffix(path.suffix)))
        shutil.move(path, shown[-1])
    return figure_rst(shown, gallery_conf["src_dir"])


sphinx_gallery_conf = {
    "image_scrapers": (written_figures,),
    "capture_repr": (),
    "examples_dirs": str(ROOT / "examples" / "gallery"),
    "gallery_dirs": "gallery",
    "filename_pattern": r"\.py$",
    "abort_on_example_error": True,
    "download_all_examples": False,
    "show_memory": False,
    "show_signature": False,
    "remove_config_comments": True,
    "within_subsection_order": "FileNameSortKey",
}

copybutton_prompt_text = "$ "
copybutton_line_continuation_character = "\\"
copybutton_exclude = ".linenos, .gp, .go"

html_theme = "pydata_sphinx_theme"
html_title = f"haptigraph {version}"
html_static_path = ["site"]
html_css_files = ["haptigraph.css"]
html_favicon = "site/haptigraph.svg"
html_show_sphinx = False
html_copy_source = False
html_show_sourcelink = False
html_theme_options = {
    "logo": {"text": "haptigraph", "image_light": "site/haptigraph.svg", "image_dark": "site/haptigraph.svg"},
    "navbar_align": "left",
    "header_links_before_dropdown": 6,
    "show_prev_next": True,
    "footer_start": ["copyright"],
    "footer_end": [],
    "secondary_sidebar_items": ["page-toc"],
    "show_toc_level": 2,
    "navigation_with_keys": False,
    "pygments_light_style": "friendly",
    "pygments_dark_style": "monokai",
}
suppress_warnings = ["config.cache"]  # sphinx_gallery_conf has a key that cannot be pickled


def _shorten_signature(
    _app: Sphinx, what: str, _name: str, item: Any, _options: Any, signature: str | None, returns: str | None
) -> tuple[str | None, str | None] | None:
    """Leave types out of the signature of a message: they stand beside its fields. A Protocol has none."""
    if what == "class" and issubclass(item, msgspec.Struct):
        fields = msgspec.structs.fields(item)
        shown = [f.name if f.required else f"{f.name}={_default(f)}" for f in fields]
        return f"({', '.join(shown)})", None
    return ("", None) if getattr(item, "_is_protocol", False) else (signature, returns)


def _default(field: msgspec.structs.FieldInfo) -> str:
    if field.default_factory is not msgspec.NODEFAULT:
        return f"{getattr(field.default_factory, '__name__', 'default')}()".replace("<lambda>()", "...")
    return (
        f"{type(field.default).__name__}()"
        if isinstance(field.default, msgspec.Struct)
        else repr(field.default)
    )


def _leave_out_of_search(app: Sphinx, _doctree: Any) -> None:
    """Leave decisions out: they would rank above the pages that say how something is done."""
    if app.env.docname.startswith("decisions/0"):
        app.env.metadata[app.env.docname]["no-search"] = "yes"


def setup(app: Sphinx) -> None:
    """Shorten signatures; a colon in a field's docstring ends no type; search finds no decisions."""
    app.connect("doctree-read", _leave_out_of_search)
    app.connect("autodoc-process-signature", _shorten_signature)
    GoogleDocstring._parse_attribute_docstring = GoogleDocstring._consume_to_end  # noqa: SLF001 - no setting
