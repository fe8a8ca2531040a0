"""Staging of the site: gathers the project's pages, those of the site alone, and linked files in one folder.

A page keeps its path in the project, so that its links to other pages stay as they are. Links to Python files and
folders lead to pages that show them. The page of commands is made from their help. `make docs` runs this before Sphinx.
"""

import argparse
import ast
import re
from collections.abc import Callable, Collection, Iterable
from pathlib import Path
from urllib.parse import urlsplit

from commands_page import commands_page
from notebook_page import notebook_to_markdown

ROOT = Path(__file__).resolve().parents[2]
SITE = Path(__file__).resolve().parent
ALWAYS = ("CHANGELOG.md", "CONTRIBUTING.md", "benchmarks/README.md", "examples/first_flight.ipynb")
"""Pages outside `docs/` that are on the site whether or not another page links to them."""
HIDDEN = "---\norphan: true\nnosearch: true\n---\n\n"
"""Front matter of pages that are reached by links alone, and not by the search."""
LINK = re.compile(r"\]\((?P<target>[^)#\s]*)(?P<rest>#[^)\s]*)?\)")
PART = re.compile(r"^<!-- part of (?P<file>\S+): (?P<name>\S+) -->$", re.MULTILINE)
OTHERS = "@other pages of docs/"
"""Line of a table of contents that stands for the pages of `docs/` that no other table of contents names."""


MARK = ".staged"
"""File that marks a folder of staged pages."""


class FolderError(ValueError):
    """A folder with files that were not staged."""


class LinkError(ValueError):
    """A link to a missing file, or an external address that is incomplete."""


def outside_code(text: str, change: Callable[[str], str]) -> str:
    """Return Markdown with its lines outside fenced blocks of code changed."""
    lines, fence = [], ""
    for line in text.split("\n"):
        mark = re.match(r"\s*(`{3,}|~{3,})", line)
        if mark and not fence:
            fence = mark[1]
        elif mark and line.strip() == fence:
            fence = ""
        elif not fence:
            line = change(line)
        lines.append(line)
    return "\n".join(lines)


def check_address(address: str, page: str) -> None:
    """Raise `LinkError` unless an external address is complete; it is not opened."""
    parts = urlsplit(address)
    mail = parts.scheme == "mailto" and "@" in parts.path
    if not mail and not (parts.scheme in ("http", "https") and "." in parts.netloc):
        raise LinkError(f"{page}: {address!r} is no address; https://example.org/page is one")


def rewritten(text: str, page: str, root: Path, made: Collection[str] = ()) -> tuple[str, list[Path]]:
    """Return a page whose links to Python files and folders lead to pages of them, and all local files that it names.

    Args:
        text: Markdown of the page.
        page: its path within the project, such as "docs/bench.md".
        root: folder of the project.
        made: names of pictures beside the page that are not files of the project.
    """
    found: list[Path] = []

    def follow(link: re.Match[str]) -> str:
        target = link["target"]
        if not target or target in made:
            return link[0]
        if urlsplit(target).scheme:
            check_address(target, page)
            return link[0]
        path = ((root / page).parent / target).resolve()
        if not path.exists() or not path.is_relative_to(root):
            raise LinkError(f"{page}: {target!r} leads nowhere in the project")
        found.append(path)
        if path.is_dir() or path.suffix == ".py":
            above = "../" * (len(Path(page).parts) - 1)
            return f"]({above}source/{path.relative_to(root).as_posix()}.md)"
        return link[0] if path.suffix != ".ipynb" else f"]({target.removesuffix('.ipynb')}.md)"

    return outside_code(text, lambda line: LINK.sub(follow, line)), found


def first_line(path: Path) -> str:
    """Return the first line of a Python file's docstring; an empty text for other files."""
    if path.suffix != ".py":
        return ""
    return (ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "").split("\n")[0]


def source_page(path: Path, root: Path) -> str:
    """Return a page that shows a Python file, or lists a folder."""
    name = path.relative_to(root).as_posix()
    if path.is_file():
        return f"{HIDDEN}# {name}\n\n``````python\n{path.read_text(encoding='utf-8')}``````\n"
    rows = []
    for each in sorted(path.iterdir()):
        if each.name.startswith((".", "__pycache__")):
            continue
        shown = f"[{each.name}]({path.name}/{each.name}.md)" if each.suffix == ".py" else f"`{each.name}`"
        rows.append(f"- {shown}" + (f": {line}" if (line := first_line(each)) else ""))
    return f"{HIDDEN}# {name}/\n\n" + "\n".join(rows) + "\n"


def with_parts(text: str, root: Path) -> str:
    """Return a page of the site with the marked parts of other files in the place of the comments that name them."""

    def part(comment: re.Match[str]) -> str:
        whole = (root / comment["file"]).read_text(encoding="utf-8")
        marks = f"<!-- {comment['name']} -->", f"<!-- /{comment['name']} -->"
        if any(whole.count(mark) != 1 for mark in marks):
            raise LinkError(f"{comment['file']} has no part {comment['name']!r} between {marks[0]} and {marks[1]}")
        return whole.split(marks[0])[1].split(marks[1])[0].strip()

    return PART.sub(part, text)


def listed(pages: Iterable[str]) -> set[str]:
    """Return the documents, without suffix, that tables of contents of the site's own pages name."""
    blocks = [block for page in pages for block in re.findall(r"^```\{toctree\}\n(.*?)^```$", page, re.S | re.M)]
    lines = [line.strip() for block in blocks for line in block.splitlines()]
    return {re.sub(r"^.*<(.*)>$", r"\1", line).strip("/") for line in lines if line and not line.startswith((":", "@"))}


class Stage:
    """The folder that Sphinx reads; files whose content is the same are left alone, so that it builds only changes."""

    def __init__(self, folder: Path, root: Path = ROOT) -> None:
        """Stage the project in `root` into `folder`."""
        self.folder, self.root = folder, root
        self.written: set[Path] = set()

    def write(self, name: str, content: str | bytes) -> None:
        """Write one file of the stage."""
        path = self.folder / name
        self.written.add(path)
        data = content.encode() if isinstance(content, str) else content
        if not path.exists() or path.read_bytes() != data:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)

    def page(self, name: str, text: str, contents: set[str], made: Collection[str] = ()) -> list[Path]:
        """Write one page of the project; returns what it links to."""
        text, found = rewritten(text, name, self.root, made)
        hidden = "" if name.removesuffix(".md") in contents else HIDDEN
        self.write(name, hidden + text)
        return found

    def notebook(self, path: Path, contents: set[str]) -> list[Path]:
        """Write a notebook as a page, and its pictures beside it; returns what it links to."""
        name = path.relative_to(self.root).with_suffix(".md")
        text, pictures = notebook_to_markdown(path)
        for picture, content in pictures.items():
            self.write((name.parent / picture).as_posix(), content)
        return self.page(name.as_posix(), text, contents, pictures)

    def claim(self) -> None:
        """Mark the folder as one of staged pages; raises `FolderError` for one that has something else."""
        mark = self.folder / MARK
        if not mark.is_file() and self.folder.exists() and (not self.folder.is_dir() or any(self.folder.iterdir())):
            raise FolderError(
                f"{self.folder} is not empty, and bears no mark of this script, which removes all that it has not"
                " written: remove it, or name another folder"
            )
        self.write(MARK, "Staged pages: everything here is written anew, or removed.\n")

    def gather(self) -> None:
        """Write all pages and what they link to, and remove what was there before."""
        self.claim()
        own = {path.relative_to(SITE / "pages").as_posix(): path for path in sorted((SITE / "pages").rglob("*.md"))}
        texts = {name: with_parts(path.read_text(encoding="utf-8"), self.root) for name, path in own.items()}
        contents = listed(texts.values())
        docs = [path for path in sorted((self.root / "docs").rglob("*.md")) if SITE not in path.parents]
        names = [path.relative_to(self.root).with_suffix("").as_posix() for path in docs]
        others = [name for name in names if name not in contents]
        waiting = [*docs, *(self.root / name for name in ALWAYS)]
        for name, text in texts.items():
            text, found = rewritten(text.replace(OTHERS, "\n".join(f"/{other}" for other in others)), name, self.root)
            self.write(name, text)
            waiting += found
        self.write("reference/commands.md", commands_page())
        self.follow(waiting, contents | set(others))
        for path in sorted(self.folder.rglob("*"), reverse=True):
            if path.is_file() and path not in self.written:
                path.unlink()

    def follow(self, waiting: list[Path], contents: set[str]) -> None:
        """Write files of the project, and those that they link to in turn."""
        done: set[Path] = set()
        while waiting:
            path = waiting.pop()
            if path in done:
                continue
            done.add(path)
            name = path.relative_to(self.root).as_posix()
            if path.suffix == ".md":
                waiting += self.page(name, path.read_text(encoding="utf-8"), contents)
            elif path.suffix == ".ipynb":
                waiting += self.notebook(path, contents)
            elif path.is_dir() or path.suffix == ".py":
                self.write(f"source/{name}.md", source_page(path, self.root))
                waiting += [each for each in path.iterdir() if each.suffix == ".py"] if path.is_dir() else []
            else:
                self.write(name, path.read_bytes())


def main() -> None:
    """Stage the site into the folder that the command line names."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder.resolve()
    try:
        Stage(folder).gather()
    except (LinkError, FolderError) as error:
        raise SystemExit(f"stage: {error}") from error


if __name__ == "__main__":
    main()
