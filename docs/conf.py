"""The site of these pages; the README has the line that builds it."""

import os
import sys
from importlib.metadata import metadata
from pathlib import Path

from jupyter_client.manager import KernelManager

# Notebook kernels warn about unencrypted TCP; the manager provides keys from jupyter_client 8.10.
if hasattr(KernelManager, "transport_encryption"):
    KernelManager.transport_encryption.default_value = "auto"
# Notebooks draw below their cells.
os.environ.pop("MPLBACKEND", None)
sys.path.insert(0, str(Path(__file__).parent / "extensions"))
_about = metadata("parametric-vibration")
project, release = _about["Name"], _about["Version"]
project_copyright = ""

extensions = ["sphinx.ext.autodoc", "myst_nb", "sphinx_copybutton", "docstrings", "executed", "mathml"]

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
myst_links_external_new_tab = False
html_math_renderer = "mathml"
nb_execution_mode = "auto"
nb_execution_timeout = 120
nb_execution_in_temp = True
nb_execution_raise_on_error = True

html_theme = "furo"
html_title = project
html_static_path = ["static"]
html_css_files = ["site.css"]
html_extra_path = ["llms.txt"]
html_show_copyright = html_show_sphinx = html_copy_source = False
html_theme_options = {"navigation_with_keys": False}
pygments_style = "friendly"

default_role = "code"
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
autodoc_default_options = {"members": True, "show-inheritance": True}
maximum_signature_line_length = 90
copybutton_prompt_text = r"\$ |>>> |\.\.\. "
copybutton_prompt_is_regexp = True

nitpicky = True
# Types in signatures, of other libraries and of packages within, have no page here; errors that are named do.
nitpick_ignore_regex = [(r"py:(?!exc).*", r".*")]
