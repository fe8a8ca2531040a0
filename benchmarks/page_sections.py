"""Generated sections of pages: scripts write measured figures between a pair of comments, so that nobody types them."""

import textwrap

WIDTH = 120
"""Characters in a line of the pages."""


def wrap(text: str, indent: str = "") -> str:
    """Return sentences wrapped as the pages are, with `indent` before each line but the first."""
    return textwrap.fill(text, WIDTH, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False) + "\n"


def beside(load: str) -> str:
    """Return in words what other work a measurement shared its machine with, by the load before it."""
    return "on an otherwise idle machine" if float(load) < 0.5 else f"beside other work with a load of {load}"


def replace_section(page: str, name: str, text: str) -> str:
    """Return the page with `text` between `<!-- name -->` and `<!-- /name -->`.

    Raises `ValueError` unless each of them is there once, in this order, the first at the end of a line.
    """
    begin, end = f"<!-- {name} -->\n", f"<!-- /{name} -->"
    before, begin_found, rest = page.partition(begin)
    _, end_found, after = rest.partition(end)
    if not (begin_found and end_found) or begin in after or end in before + after:
        raise ValueError(f"the page needs one pair of marks, {begin.strip()} and {end}, each at the start of a line")
    return before + begin + text + end + after
