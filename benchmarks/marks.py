"""Where do measured figures stand in a page? Between a pair of marks, so that scripts write them and nobody types."""

import textwrap

WIDTH = 120
"""Characters of a line of our pages."""


def prose(text: str) -> str:
    """Sentences, wrapped as our pages are."""
    return textwrap.fill(text, WIDTH, break_long_words=False, break_on_hyphens=False) + "\n"


def between_marks(page: str, mark: str, text: str) -> str:
    """The page with `text` between `<!-- mark -->` and `<!-- /mark -->`.

    Raises `ValueError` where they do not stand there once each, in order, the first at the end of a line.
    """
    begin, end = f"<!-- {mark} -->\n", f"<!-- /{mark} -->"
    before, begun, rest = page.partition(begin)
    _, ended, after = rest.partition(end)
    if not (begun and ended) or begin in after or end in before + after:
        raise ValueError(f"the page needs one pair of marks, {begin.strip()} and {end}, each at the start of a line")
    return before + begin + text + end + after
