"""The documentation is current, and what it links to is there."""

import importlib.util
import re
import shlex
from pathlib import Path
from types import ModuleType

import pytest

from meshlab_svbrdf.registry import get, load
from meshlab_svbrdf.script import check_script, read_script

ROOT = Path(__file__).parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("sample_projects/*.md")])
LINK = re.compile(r"\]\(([^)\s]+)\)|(?:src|href)=\"([^\"]+)\"")
CODE = re.compile(r"```.*?```|`[^`\n]*`", re.DOTALL)


@pytest.fixture(scope="module")
def tool():
    spec = importlib.util.spec_from_file_location("make_filters", ROOT / "docs/make_filters.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def anchors(text):
    """The anchors of a page's headings, as GitHub names them."""
    headings = re.findall(r"^#+ (.*)$", re.sub(r"```.*?```", "", text, flags=re.DOTALL), re.M)
    return {re.sub(r"[^\w\- ]", "", h.lower()).strip().replace(" ", "-") for h in headings}


def test_pages_are_what_the_descriptors_say(tool):
    for path, text in tool.current().items():
        behind = f"{path.name} is behind the descriptors: run python docs/make_filters.py"
        assert path.read_text(encoding="utf-8") == text, behind


def test_every_filter_is_explained_on_a_page(tool):
    texts = [p.read_text(encoding="utf-8") for p in PAGES if p.name != "filters.md"]
    explained = {match[1] for text in texts for match in tool.PART.finditer(text)}
    assert explained == set(tool.own_filters())


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    text = CODE.sub("", page.read_text(encoding="utf-8"))
    for found in LINK.finditer(text):
        target, _, anchor = (found[1] or found[2]).partition("#")
        if target.startswith(("http://", "https://", "mailto:")):
            continue
        path = (page.parent / target).resolve() if target else page
        assert path.exists(), f"{page.name} links to {target}, which is not there"
        if anchor and path.suffix == ".md":
            assert anchor in anchors(path.read_text(encoding="utf-8")), f"{page.name}: #{anchor}"


def test_pictures_are_small_and_used():
    pictures = sorted((ROOT / "docs/images").glob("*"))
    text = "".join(page.read_text(encoding="utf-8") for page in PAGES)
    assert sum(picture.stat().st_size for picture in pictures) < 3_000_000
    for picture in pictures:
        assert picture.name in text, f"no page shows {picture.name}"
        assert picture.stat().st_size < 400_000


def blocks(page, language):
    """The code blocks of a page."""
    text = (ROOT / page).read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.DOTALL | re.M)


@pytest.mark.parametrize("page", ["README.md", "docs/paper.md"])
def test_scripts_are_accepted(page, tmp_path):
    for script in blocks(page, "xml"):
        (tmp_path / "chain.mlx").write_text(script, encoding="utf-8")
        check_script(read_script(tmp_path / "chain.mlx"))


def test_filter_of_the_guide_is_a_filter():
    (code,) = blocks("CONTRIBUTING.md", "python")
    module = ModuleType("compute_svbrdf_contrast")
    exec(compile(code, "CONTRIBUTING.md", "exec"), module.__dict__)
    assert load(module).check({"floor": 2}).floor == 2


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_python_examples_compile_and_name_filters_that_exist(page):
    for code in blocks(page, "python"):
        compile(code, page.name, "exec")
        for call in re.finditer(r"\bms\.(\w*svbrdf\w*)\(", code):
            get(call[1])


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_shell_examples_give_parameters_that_exist(page):
    for code in blocks(page, "sh"):
        for line in re.findall(r"meshlab-svbrdf apply (.*)", re.sub(r"\\?\n +", " ", code)):
            _, name, *given = shlex.split(line, comments=True)
            get(name).check(dict(word.split("=", 1) for word in given))
