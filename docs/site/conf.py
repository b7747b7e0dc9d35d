"""The documentation site: `make docs` writes it to `site/`.

Sphinx reads the Markdown pages of the repository where they are, so that the same links work on
GitHub and in the site; docs/README.md is the navigation, see `pages.py`. Links to other files of
the repository lead to pages that show them, see `sources.py`.
"""

from pathlib import Path
import sys

import yaml

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(Path(__file__).parent)]

citation = yaml.safe_load((ROOT / 'CITATION.cff').read_text('utf-8'))
project = citation['title']
author = citation['authors'][0]['name']
version = release = citation['version']
copyright = author

extensions = [
    'myst_nb',  # Markdown and notebooks
    'docstrings',
    'pages',
    'sources',
    'sphinx.ext.autodoc',
    'sphinx.ext.napoleon',
    'sphinx_copybutton',
]

# ------------------------------------------------------------------------------------- pages
root_doc = 'README'
include_patterns = [
    'README.md',
    'CHANGELOG.md',
    'CONTRIBUTING.md',
    'SECURITY.md',
    'controllers/README.md',
    'docs/**.md',
    'docs/**.ipynb',
]
exclude_patterns = ['.*', 'ros2_ws', 'runs', 'site', 'tests', '**/.ipynb_checkpoints']
myst_enable_extensions = ['dollarmath']
myst_heading_anchors = 4  # GitHub's anchors
# `make docs` runs the notebooks; the tests of the site do not, as they have tests of their own.
nb_execution_mode = 'force'
nb_execution_in_temp = True
nb_execution_timeout = 300
nb_execution_raise_on_error = True
nb_merge_streams = True

# --------------------------------------------------------------------------------------- API
smartquotes = False  # docstrings quote values
default_role = 'code'  # docstrings have words of code in single backticks
autodoc_member_order = 'bysource'
autodoc_typehints = 'signature'
python_maximum_signature_line_length = 80
python_use_unqualified_type_names = True
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True

# -------------------------------------------------------------------------------------- looks
html_theme = 'furo'
html_title = project
html_extra_path = ['index.html']  # leads to the first page
html_static_path = ['static']
html_css_files = ['site.css']
html_copy_source = False
html_show_sphinx = False
pygments_style = 'tango'
pygments_dark_style = 'monokai'
