"""The pages of the docs can be found, and what they link to is there."""

import re
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def pages() -> list[Path]:
    """Every Markdown page that the project tracks or is about to."""
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard", "*.md"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    names = listed.stdout.split() if listed.returncode == 0 else []
    found = [ROOT / name for name in names] or [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")]
    return [page for page in found if page.exists()]


def links(page: Path) -> list[str]:
    """Targets within the project that the page links to or shows."""
    targets = re.findall(r"\]\(([^)#\s]+)[^)]*\)", page.read_text())
    return [target for target in targets if "://" not in target and not target.startswith("mailto:")]


def test_every_link_within_the_project_leads_somewhere():
    broken = [f"{page.name}: {link}" for page in pages() for link in links(page) if not (page.parent / link).exists()]
    assert broken == []


def test_every_page_of_the_docs_is_linked_from_its_index():
    index = ROOT / "docs" / "README.md"
    linked = {(index.parent / link).resolve() for link in links(index)}
    for page in pages():
        if page.parent == index.parent and page != index:
            assert page in linked, f"{page.name} is not listed in docs/README.md"
