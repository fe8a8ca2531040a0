"""Writes the findings to the top of `docs/findings.md`, and the first of them with its table into the README.

    python benchmarks/headline_page.py            # writes both pages and draws the pictures
    python benchmarks/headline_page.py --check    # writes nothing; fails where a page is not up to date

The prose of these pages is tested against the results in tests/benchmarks/test_findings_prose.py.
"""

import argparse
import itertools
import sys
from collections.abc import Sequence
from pathlib import Path

from findings import results_of
from headline import Headline
from headline_pictures import drawn
from headlines import HERE, STUDY, headlines
from page_sections import replace_section, wrap
from study_flights import algorithms, earlier_versions, flown, listed, reference

from thalweg.bench.report.policies import CRITICS_SEE, evaluated_seeds, limit_met, train_level
from thalweg.bench.report.table import frame, markdown
from thalweg.bench.results.inference import mean_estimate
from thalweg.bench.results.results import Results
from thalweg.core.atomic_io import write_atomic

ROOT = Path(__file__).resolve().parent.parent
PAGE, README = ROOT / "docs" / "findings.md", ROOT / "README.md"
PICTURES = ROOT / "docs" / "images" / "findings"


def findings_section(found: Sequence[Headline]) -> str:
    """Return the findings with their pictures, and what versions they are of."""
    blocks = [
        f"{wrap(f'**{number}. {each.title}.** {each.sentence}')}\n{_picture(each, 'images/findings')}"
        for number, each in enumerate(found, start=1)
    ]
    return "\n".join([*blocks, wrap(_versions_note(found))])


def _picture(headline: Headline, folder: str) -> str:
    """Return a picture with what it shows in words."""
    beside = f": {', '.join(headline.series)}" if len(headline.series) > 1 else ""
    words = f"{headline.title}: {headline.axis} by algorithm{beside}, with 95 % confidence intervals"
    return f"![{words}]({folder}/{headline.name}.png)\n"


def _versions_note(found: Sequence[Headline]) -> str:
    """Return which findings are of earlier versions than today's."""
    numbers: dict[tuple[str, ...], list[str]] = {}
    for number, each in enumerate(found, start=1):
        lists = (earlier_versions(results_of(HERE / folder)) for folder in each.folders)
        numbers.setdefault(tuple(dict.fromkeys(itertools.chain(*lists))), []).append(str(number))
    return " ".join(
        f"**{_are(own)} of earlier versions**: {', '.join(earlier)}."
        if earlier
        else f"{_are(own)} of today's versions."
        for earlier, own in numbers.items()
    )


def _are(numbers: Sequence[str]) -> str:
    """Return the subject of a sentence about findings of some numbers, with its verb."""
    return f"Findings {listed(numbers)} are" if len(numbers) > 1 else f"Finding {listed(numbers)} is"


def readme_section(found: Sequence[Headline], results: Results) -> str:
    """Return the table of the study on the training level, the picture of the first finding, and its versions."""
    level, rows = train_level(results), []
    names, base = algorithms(results), reference(results)
    if base not in names and flown(results, base):
        names.insert(1, base)
    for name in names:
        own = flown(results, name)
        cost = mean_estimate(own, "cost")
        returns = str(mean_estimate(own, "return_"))
        seen = results.critics_see(name)
        rows.append([name, evaluated_seeds(results, name, own), returns, str(cost), limit_met(cost), seen])
    columns = ["algorithm", "seeds", f"return on {level}", "cost", "limit of 0.1 met", CRITICS_SEE]
    table = markdown(frame(columns, rows))
    picture = _picture(found[0], "docs/images/findings")
    earlier = earlier_versions(results)
    note = f"These results are of earlier versions: {', '.join(earlier)}." if earlier else ""
    return "\n".join([wrap(found[0].sentence), table, picture, *([wrap(note)] if note else [])])


def written_pages() -> dict[Path, str]:
    """Return both pages with what the results have today."""
    found, results = headlines(), results_of(STUDY)
    sections = {
        PAGE: ("headlines", findings_section(found)),
        README: ("findings", readme_section(found, results)),
    }
    return {page: replace_section(page.read_text(encoding="utf-8"), *section) for page, section in sections.items()}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="write nothing; fail where a page is not up to date")
    check, pages = parser.parse_args().check, written_pages()
    if check:
        return int(any(page.read_text(encoding="utf-8") != text for page, text in pages.items()))
    for page, text in pages.items():
        write_atomic(page, text)
    PICTURES.mkdir(parents=True, exist_ok=True)
    for each in headlines():
        write_atomic(PICTURES / f"{each.name}.png", drawn(each))
    return 0


if __name__ == "__main__":
    sys.exit(main())
