"""Settings of the site that `make site` builds with Sphinx: the repository's Markdown and the API.

The site has the folders of the repository, so that one link holds here and there.
"""

import re
import subprocess
import sys
from pathlib import Path

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml

ROOT = Path(__file__).parents[1]

project, author, html_title = "gstlib", "", "Where does a ground stone tool wear?"
root_doc = "docs/index"
include_patterns = ["*.md", "docs/**.md", "config/README.md", "benchmarks/README.md"]
exclude_patterns = [".*", "build", "results*"]
extensions = ["myst_parser", "sphinx.ext.autodoc", "numpydoc"]
myst_heading_anchors = 3
myst_fence_as_directive = ["math"]  # the fences that the code host renders, too
html_math_renderer = "mathml"  # MathJax would be fetched from elsewhere
highlight_language = "none"  # commands stand in blocks of plain text
default_role = (
    "py:obj"  # names in the docstrings' single backticks are links; those that begin
)
nitpicky = True  # with gstlib have to lead somewhere
nitpick_ignore_regex = [("py:class", ".*"), ("py:.*", r"(?!gstlib\.).*")]
numpydoc_show_class_members = False
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
html_theme = "furo"
html_show_sourcelink = html_show_copyright = html_show_sphinx = False
html_show_search_summary = False  # a page opened from its file cannot read the others

LIST = re.compile(r"^## (.+)\n\n((?:- .*\n(?: .*\n)*)+)", re.M)
SCRIPT = re.compile(r"^\[(gallery/(\w+)\.py)\].*\n", re.M)


def with_contents(found):
    """A list of documents, and the part of the navigation that it is."""
    entries = re.sub(
        r"^- \[(.*?)\]\((.*?)\.md\).*\n(?: .*\n)*", r"\1 <\2>\n", found[2], flags=re.M
    )
    return (
        f"{found[0]}\n```{{toctree}}\n:caption: {found[1]}\n:hidden:\n\n{entries}```\n"
    )


def with_results(found):
    """The link to a script, its text, and what it prints and draws when it is run here."""
    folder, script = ROOT / "build/gallery", ROOT / "docs" / found[1]
    folder.mkdir(parents=True, exist_ok=True)
    run = [sys.executable, str(script)]
    printed = subprocess.run(
        run, cwd=folder, check=True, stdout=subprocess.PIPE, text=True
    ).stdout
    code = re.sub(r"^# %%.*\n", "", script.read_text(encoding="utf-8"), flags=re.M)
    picture = f"![Figure drawn by {script.name}](/build/gallery/{found[2]}.png)"
    return f"{found[0]}\n```python\n{code}```\n\nprints\n\n```\n{printed}```\n\n{picture}\n"


def read(app, name, source):
    if name == root_doc:
        source[0] = LIST.sub(with_contents, source[0])
    if name == "docs/gallery":
        source[0] = SCRIPT.sub(with_results, source[0])
    if name == "paper":  # the journal takes its title from the front matter
        _, front, body = source[0].split("---\n", 2)
        title = re.search(r"^title: '(.*)'$", front, re.M)[1]
        source[0] = f"# {title}\n" + re.sub(r"^# ", "## ", body, flags=re.M)


def as_mathml(translator, node):
    """An equation as MathML, which browsers draw by themselves."""
    is_block = isinstance(node, nodes.math_block)
    equation = tex2mathml(node.astext(), as_block=is_block)
    if is_block:  # with room around it, or the theme adds a scroll bar
        equation = f'<div class="math" style="padding: .5em 0">{equation}</div>'
    translator.body.append(equation)
    raise nodes.SkipNode


def lead_to_start(app, exception):
    (Path(app.outdir) / "index.html").write_text(
        f'<meta http-equiv="refresh" content="0; url={root_doc}.html">',
        encoding="utf-8",
    )


def setup(app):
    app.add_html_math_renderer("mathml", (as_mathml, None), (as_mathml, None))
    app.connect("source-read", read)
    app.connect("build-finished", lead_to_start)
