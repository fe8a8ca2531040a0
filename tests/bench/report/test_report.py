"""Tests of what a report contains, without its figures."""

import csv
import json
import re
from pathlib import Path
from typing import Any

import pytest

from tests.bench.small_backend import write_film_of
from tests.bench.versioned import record_current_versions
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.report.html.page import page
from thalweg.bench.report.report import write_report
from thalweg.bench.report.result_tables import detail_table, paper_table
from thalweg.bench.report.sections import SECTIONS, TableSection
from thalweg.bench.report.table import PAPER, latex, markdown
from thalweg.bench.results.reading import read_results

STUDY = Path(__file__).resolve().parents[3] / "benchmarks" / "paper"

pytestmark = pytest.mark.usefixtures("no_pictures")


def table_of(folder: Path) -> dict[str, list[str]]:
    text = paper_table(read_results(folder)).text
    return {policy: cells for policy, *cells in text.itertuples(index=False)}


def test_the_table_holds_means_and_deviations_computed_by_hand(tiny_results: Path):
    assert table_of(tiny_results)["PPO"] == [
        "1 of 2",
        "7.00 ± 3.00",
        "0.50 ± 0.50",
        "1.50 ± 0.50",
        "0.60 ± 0.40",
    ]


def test_published_figures_stand_beside_ours_and_are_marked(tiny_results: Path):
    rows = table_of(tiny_results)
    assert rows["PPO (paper, another simulator)"] == ["3", "9.19 ± 2.63", "0.09 ± 0.28", "5.22 ± 3.89", "0.74 ± 0.44"]
    assert "hover (paper, another simulator)" not in rows


def with_suite(folder: Path, **changes: object) -> None:
    """Change keys of the suite of some results; runs of PPO have the versions of what it then sees."""
    suite = json.loads((folder / "suite.json").read_text())
    (folder / "suite.json").write_text(json.dumps(suite | changes))
    rules: dict[str, Any] = {"task": changes.get("task", "River"), "forces": "forces" in changes}
    record_current_versions(folder, observation=str(changes.get("observation", "frames")), **rules)


def test_published_figures_of_frames_do_not_stand_below_policies_that_see_none(tiny_results: Path):
    with_suite(tiny_results, observation="privileged")
    assert list(table_of(tiny_results)) == ["hover", "PPO"]
    sources = {row["source"] for row in csv.DictReader(paper_table(read_results(tiny_results)).csv.splitlines())}
    assert sources == {"thalweg"}


WIND = {"wind": {"speed_m_per_s": [1.0, 3.0]}, "current_m_per_s": [0.5, 0.5]}


@pytest.mark.parametrize(
    ("rules", "sentence"),
    [
        ({"task": "Swimmers", "hard": True}, "The task is Swimmers, in hard mode."),
        ({"forces": WIND}, "The task is River, under wind and a current."),
        ({"forces": {"dynamics": "inertial"}}, "The task is River, under inertia."),
    ],
)
def test_other_rules_are_named_and_no_published_figures_stand_below_them(
    tiny_results: Path, rules: dict, sentence: str
):
    with_suite(tiny_results, **rules)
    results = read_results(tiny_results)
    assert not results.outdated and set(paper_table(results).text.iloc[:, 0]) == {"hover", "PPO"}
    assert sentence in write_report(tiny_results).page.read_text()


def test_the_page_says_which_policies_see_no_frames(tiny_results: Path):
    said = "see what a perfect camera could tell (the privileged observation) instead of frames."
    assert said not in write_report(tiny_results).page.read_text()
    with_suite(tiny_results, observation="privileged")
    assert f"The trained policies {said}" in write_report(tiny_results).page.read_text()
    eye = {"name": "eye", "algorithm": "PPO", "seeds": [0], "steps": 9, "observation": "privileged"}
    arms = [{"name": "PPO", "algorithm": "PPO", "seeds": [0, 1], "steps": 400}, eye]
    with_suite(tiny_results, arms=arms, observation="frames")
    assert f" eye {said}" in write_report(tiny_results).page.read_text()
    with_suite(tiny_results, arms=[arms[0], eye | {"observation": "rgb"}], observation="frames")
    page = write_report(tiny_results).page.read_text()
    assert " eye see images (rgb) instead of codes of frames." in page and said not in page


@pytest.mark.parametrize(
    ("arms", "sentence"),
    [
        ([{}], "2 training runs of 400 steps on Medium (2 seeds)."),
        ([{}, {"name": "one", "seeds": [0], "steps": 9}], "of 9 or 400 steps on Medium (1 or 2 seeds)."),
        (
            [
                {"level": "Hard"},
                {
                    "name": "in-turn",
                    "steps": 150,
                    "level": "Hard",
                    "before": [{"steps": 100, "level": "Easy"}, {"steps": 150, "level": "Medium"}],
                },
                {"name": "after", "steps": 300, "before": [{"steps": 100, "level": "Medium"}]},
            ],
            "of 400 steps on Hard, on Easy then Medium then Hard, or on Medium (2 seeds).",
        ),
    ],
)
def test_the_page_counts_the_steps_of_all_stages_and_names_their_levels(
    tiny_results: Path, arms: list[dict], sentence: str
):
    usual = {"name": "PPO", "algorithm": "PPO", "seeds": [0, 1], "steps": 400}
    with_suite(tiny_results, arms=[usual | arm for arm in arms])
    assert sentence in write_report(tiny_results).page.read_text()


def test_the_page_says_whose_critics_saw_more_in_training(tiny_results: Path):
    page = write_report(tiny_results).page.read_text()
    assert "In training, the critics of all policies also saw the privileged state and progress." in page
    arms = [{"name": name, "algorithm": name, "seeds": [0, 1], "steps": 400} for name in ("PPO", "CUP")]
    with_suite(tiny_results, arms=arms)
    assert "the critics of PPO also saw the privileged state" in write_report(tiny_results).page.read_text()
    with_suite(tiny_results, arms=[arms[1]])
    assert "the critics of" not in write_report(tiny_results).page.read_text()


def test_conditions_of_the_appearance_are_not_planned_for_policies_that_see_no_frames(tiny_results: Path):
    haze, mode = ({"name": name, "levels": ["Easy"], "rivers": {}, "blind": False} for name in ("haze", "mode"))
    conditions = [haze | {"varied": ["haze"]}, mode | {"varied": []}]
    every = {"", "haze", "mode"}
    for changes, flown in (
        ({}, every),
        ({"observation": "privileged"}, {"", "mode"}),
        ({"observation": "rgb"}, every),
    ):
        with_suite(tiny_results, conditions=conditions, **changes)
        planned = read_results(tiny_results).planned_flights
        assert {condition for condition, name, *_ in planned if name == "PPO"} == flown


def test_a_level_that_was_not_flown_is_called_missing(tiny_results: Path):
    assert table_of(tiny_results)["hover"] == ["1", "0.05 ± 0.00", "0.20 ± 0.00", "missing", "missing"]


def add_runs(folder: Path, *lines: str) -> None:
    runs = folder / "runs.csv"
    runs.write_text(runs.read_text() + "".join(f"{line}\n" for line in lines))


def test_an_algorithm_whose_every_run_failed_is_a_row_that_says_so(tiny_results: Path):
    add_runs(tiny_results, "FOCOPS-0,train,FOCOPS,0,90,failed,NaN,1.0,90.0")
    rows = table_of(tiny_results)
    assert list(rows) == ["hover", "PPO", f"PPO ({PAPER})", "FOCOPS", f"FOCOPS ({PAPER})"]
    assert rows["FOCOPS"] == ["0 of 1", *["failed"] * 4]
    assert rows[f"FOCOPS ({PAPER})"][:2] == ["3", "7.83 ± 3.74"]


def test_a_packaged_policy_that_is_not_there_is_a_row_that_says_so(tiny_results: Path):
    add_runs(tiny_results, "packaged-0,packaged,packaged,0,0,absent,none,0.0,0.0")
    assert table_of(tiny_results)["packaged"] == ["0 of 1", *["absent"] * 4]


def test_an_algorithm_of_the_suite_that_has_not_run_yet_is_missing(tiny_results: Path):
    suite = tiny_results / "suite.json"
    suite.write_text(suite.read_text().replace('["PPO"]', '["PPO", "P3O"]'))
    assert table_of(tiny_results)["P3O"] == ["0 of 2", *["missing"] * 4]


def test_gaps_stand_in_every_table(tiny_results: Path):
    add_runs(tiny_results, "FOCOPS-0,train,FOCOPS,0,90,failed,NaN,1.0,90.0")
    results = read_results(tiny_results)
    assert detail_table(results).text.iloc[:, :4].to_numpy().tolist() == [
        ["hover", "Easy", "2", "1"],
        ["hover", "Medium", "missing", "0 of 1"],
        ["PPO", "Easy", "2", "1 of 2"],
        ["PPO", "Medium", "2", "1 of 2"],
        ["FOCOPS", "Easy", "failed", "0 of 1"],
        ["FOCOPS", "Medium", "failed", "0 of 1"],
    ]
    table = list(csv.DictReader(paper_table(results).csv.splitlines()))
    ours = [
        (row["policy"], row["level"], row["seeds"], row["planned_seeds"]) for row in table if row["source"] == "thalweg"
    ]
    assert ours[-2:] == [("FOCOPS", "Easy", "0", "1"), ("FOCOPS", "Medium", "0", "1")]
    assert ours[2] == ("PPO", "Easy", "1", "2")


def test_the_details_as_csv_hold_values_computed_by_hand_at_full_precision(tiny_results: Path):
    medium = tiny_results / "evaluation" / "PPO-0-Medium.csv"
    medium.write_text(medium.read_text().replace("0.0,1.0,1.0,1.0", "0.0,1.123456789012345,1.0,1.0"))
    rows = list(csv.DictReader(detail_table(read_results(tiny_results)).csv.splitlines()))
    assert [(row["policy"], row["level"], row["seeds"], row["planned_seeds"]) for row in rows] == [
        ("hover", "Easy", "1", "1"),
        ("hover", "Medium", "0", "1"),
        ("PPO", "Easy", "1", "2"),
        ("PPO", "Medium", "1", "2"),
    ]
    _, gap, easy, flown = rows
    assert set(list(gap.values())[5:]) == {""}
    assert float(flown["return_iqm"]) == (1.123456789012345 + 2) / 2
    assert (flown["return_iqm_low"], flown["return_iqm_high"]) == ("", "")
    assert [float(easy[name]) for name in ("success", "tight", "loose", "progress_mean")] == [0.5, 0.5, 0.0, 0.7]
    assert (easy["success_low"], easy["success_high"]) == ("", "")  # of one seed


def test_the_runs_beside_the_page_are_those_of_the_results_with_their_errors(tiny_results: Path):
    rows = list(csv.DictReader((write_report(tiny_results).folder / "runs.csv").open()))
    assert [(row["run"], row["status"], row["wall_s"]) for row in rows] == [
        ("hover-0", "finished", "0.0"),
        ("PPO-0", "finished", "2.0"),
        ("PPO-1", "failed", "1.0"),
    ]
    assert rows[2]["error"] == "NotFiniteError: the loss is NaN <at step 300>"


def test_a_table_without_rows_says_so_and_has_no_files(tiny_results: Path):
    (tiny_results / "runs.csv").unlink()
    report = write_report(tiny_results)
    assert "<h2>Runs</h2>\n<p>There is nothing to show.</p>" in report.page.read_text()
    assert list(report.folder.glob("runs.*")) == []


def test_films_of_policies_stand_beside_one_another_with_what_they_show(tiny_results: Path):
    assert "typical failure" not in write_report(tiny_results).page.read_text()
    for name in ("film", "films/PPO-best", "films/PPO-failure"):
        write_film_of(tiny_results, name)
    (tiny_results / "films" / "PPO-failure.txt").unlink()  # killed before it was whole
    (tiny_results / "films" / "hover-best-error.txt").write_text("RuntimeError: no ffmpeg\n")
    text = write_report(tiny_results).page.read_text()
    _, section = text.split("best flight and typical failure</h2>")
    assert section.split("</section>")[0].count("<video ") == 1
    assert "<figcaption>What films/PPO-best shows. This flight is no longer among the results.</figcaption>" in section
    assert "aria-label='Film of a flight: PPO, best'" in section
    assert "<li>No film films/hover-best: RuntimeError: no ffmpeg</li>" in text
    assert "<li>Not used: films/PPO-failure.mp4: there is no films/PPO-failure.txt" in text
    (tiny_results / "films" / "hover-best-error.txt").write_bytes(b"\xff")
    assert "Not used: films/hover-best-error.txt is not text" in write_report(tiny_results).page.read_text()


def test_a_failed_run_is_named_with_its_error(tiny_results: Path):
    page = write_report(tiny_results).page.read_text()
    assert "Run PPO-1 failed: NotFiniteError: the loss is NaN &lt;at step 300&gt;" in page


def test_a_report_says_what_is_still_missing(tiny_results: Path):
    """PPO-0 and the failed PPO-1 aside, nothing is planned: hover is no baseline of this suite."""
    assert not any(line.startswith("Unfinished") for line in write_report(tiny_results).problems)
    (tiny_results / "evaluation" / "PPO-0-Medium.csv").unlink()
    missing = "Unfinished: 1 of 2 evaluations are missing; the same command resumes the suite"
    assert missing in write_report(tiny_results).problems
    assert missing in (tiny_results / "report" / "report.html").read_text()


def test_numbers_come_from_the_files(tiny_results: Path):
    file = tiny_results / "evaluation" / "PPO-0-Easy.csv"
    file.write_text(file.read_text().replace(",4.0,1.0,1.0,", ",8.0,1.0,1.0,"))
    assert "9.00 ± 1.00" in write_report(tiny_results).page.read_text()


def spoil_half_written(folder: Path) -> str:
    file = folder / "evaluation" / "PPO-0-Easy.csv"
    file.write_text(file.read_text()[:-20])
    return "evaluation/PPO-0-Easy.csv is half-written"


def spoil_foreign(folder: Path) -> str:
    (folder / "evaluation" / "notes.txt").write_text("hello")
    return "evaluation/notes.txt: not a result of an evaluation"


def spoil_columns(folder: Path) -> str:
    (folder / "evaluation" / "PPO-0-Easy.csv").write_text("a,b\n1,2\n")
    return "evaluation/PPO-0-Easy.csv lacks the columns algorithm"


def spoil_clash(folder: Path) -> str:
    (folder / "evaluation" / "PPO-0-Hard.csv").write_text((folder / "evaluation" / "PPO-0-Easy.csv").read_text())
    return "evaluation/PPO-0-Hard.csv holds the episodes of PPO-0-Easy"


def spoil_bytes(folder: Path) -> str:
    (folder / "evaluation" / "PPO-0-Easy.csv").write_bytes(b"\xff\xfe\x00")
    return "evaluation/PPO-0-Easy.csv is not text"


def spoil_repeated(folder: Path) -> str:
    file = folder / "evaluation" / "PPO-0-Easy.csv"
    file.write_text(file.read_text() + file.read_text().splitlines()[-1] + "\n")
    return "evaluation/PPO-0-Easy.csv lacks or repeats episodes"


def spoil_number(folder: Path) -> str:
    file = folder / "evaluation" / "PPO-0-Easy.csv"
    file.write_text(file.read_text().replace(",4.0,1.0,1.0,", ",nan,1.0,1.0,"))
    return "evaluation/PPO-0-Easy.csv line 3: return: a finite number is needed, got"


def spoil_training(folder: Path) -> str:
    (folder / "runs" / "PPO-0" / "episodes.csv").write_text("step,return\n1")
    return "runs/PPO-0/episodes.csv lacks the columns tight, loose"


SPOILS = (
    spoil_half_written,
    spoil_foreign,
    spoil_columns,
    spoil_clash,
    spoil_bytes,
    spoil_repeated,
    spoil_number,
    spoil_training,
)


@pytest.mark.parametrize("spoil", SPOILS)
def test_a_file_that_cannot_be_used_is_skipped_by_name(tiny_results: Path, spoil):
    said = spoil(tiny_results)
    (line,) = read_results(tiny_results).skipped
    assert line.startswith(said)
    assert f"Not used: {said}" in write_report(tiny_results).page.read_text()


def test_what_a_killed_process_was_writing_is_no_result(tiny_results: Path):
    (tiny_results / "evaluation" / ".PPO-0-Easy.0123456789abcdef.part.csv").write_text("half")
    assert read_results(tiny_results).skipped == []


def test_a_folder_without_results_is_named_once_with_what_would_be_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    for folder in (Path(), tmp_path):
        with pytest.raises(ResultsError) as refused:
            write_report(folder)
        needed = "holds no results: no suite.json lies in it. Give a folder that `thalweg bench` wrote"
        assert str(refused.value) == f"{folder} {needed}"
    assert list(tmp_path.iterdir()) == []


def test_results_without_an_episode_say_what_of_them_was_not_used(tmp_path: Path):
    (tmp_path / "evaluation").mkdir()
    (tmp_path / "evaluation" / "PPO-0-Easy.csv").write_text("")
    with pytest.raises(ResultsError) as refused:
        write_report(tmp_path)
    assert str(refused.value).splitlines() == [
        f"{tmp_path} holds no evaluated episodes",
        "  suite.json cannot be read: No such file or directory",
        "  evaluation/PPO-0-Easy.csv is empty",
    ]


def cells(page: str) -> list[list[str]]:
    """The cells of every table of a page, a list for each row."""
    rows = re.findall(r"<tr[^>]*>(.*?)</tr>", page)
    return [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row) for row in rows]


def test_no_cell_of_the_page_is_blank(tiny_results: Path):
    suite = tiny_results / "suite.json"
    suite.write_text(suite.read_text().replace('["Easy", "Medium"]', '["Easy", "Medium", "Delta"]'))
    rows = cells(write_report(tiny_results).page.read_text())
    assert len(rows) > 10
    assert [row for row in rows if not all(cell.strip() for cell in row)] == []
    assert ["hover-0", "baseline", "finished", "not trained", "not trained", "not trained"] in rows
    assert ["hover", "Delta", "missing", "0 of 1", *["missing"] * 7, "none"] in rows
    (published,) = (row for row in rows if row[0] == f"PPO ({PAPER})")
    assert published[-3:] == ["not published", "not published", "what the policy sees"]


def test_a_report_is_replaced_completely_or_not_at_all(tiny_results: Path, monkeypatch: pytest.MonkeyPatch):
    report = write_report(tiny_results)
    before = report.page.read_bytes()

    def full_disk(*_, **__):
        raise OSError("no space left on device")

    monkeypatch.setattr("thalweg.bench.report.report.page", full_disk)
    with pytest.raises(OSError, match="no space"):
        write_report(tiny_results)
    assert report.page.read_bytes() == before
    assert not list(tiny_results.glob(".*"))


def test_a_folder_with_anything_else_in_it_is_refused_and_left_as_it_was(tiny_results: Path, tmp_path: Path):
    home = tmp_path / "home"
    home.mkdir()
    (home / "thesis.tex").write_text("years of work")
    with pytest.raises(ResultsError, match=r"home holds thesis.tex, which is no part of a report"):
        write_report(tiny_results, home)
    assert [file.name for file in home.iterdir()] == ["thesis.tex"]


def test_a_report_is_refused_in_the_results_folder(tiny_results: Path):
    before = sorted(file.name for file in tiny_results.iterdir())
    for out in (tiny_results, tiny_results / "report" / ".."):
        with pytest.raises(ResultsError, match="the results themselves"):
            write_report(tiny_results, out)
    for out in (tiny_results / "evaluation", tiny_results.parent):
        with pytest.raises(ResultsError, match="no part of a report"):
            write_report(tiny_results, out)
    assert sorted(file.name for file in tiny_results.iterdir()) == before


def test_a_file_where_the_folder_should_be_is_refused(tiny_results: Path, tmp_path: Path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ResultsError, match="file is not a folder"):
        write_report(tiny_results, tmp_path / "file")


def test_what_a_killed_report_left_is_in_nobodys_way(tiny_results: Path, tmp_path: Path):
    out = tmp_path / "out"
    write_report(tiny_results, out)
    (out / ".table.0123456789abcdef.part.md").write_text("| pol")
    assert write_report(tiny_results, out).table.read_text().startswith("| policy |")


def test_files_of_an_earlier_report_that_this_one_lacks_are_removed(tiny_results: Path):
    write_film_of(tiny_results)
    assert write_report(tiny_results).film is not None
    (tiny_results / "film.mp4").unlink()
    report = write_report(tiny_results)
    assert report.film is None
    assert not (report.folder / "film.mp4").exists()


@pytest.mark.slow
def test_the_committed_tables_of_the_study_are_those_of_its_results():
    results, folder = read_results(STUDY, as_recorded=True), STUDY / "report"
    tables = {section.name: section.table(results) for section in SECTIONS if isinstance(section, TableSection)}
    shown = {name: table for name, table in tables.items() if not table.text.empty}
    assert {"price", "area"} == {*tables} - {*shown}, "the paper's task has no tables of prices"
    for name, table in shown.items():
        assert (folder / f"{name}.md").read_text() == markdown(table.text), name
        assert (folder / f"{name}.tex").read_text() == latex(table.text), name
        texts = (folder / f"{name}.csv").read_text(), table.csv
        committed, computed = (list(csv.reader(text.splitlines())) for text in texts)
        assert committed[0] == computed[0] and len(committed) == len(computed), name
        for old, new in zip(committed, computed, strict=True):
            assert [as_number(cell) for cell in old] == [as_number(cell) for cell in new], name
    committed_page = (folder / "report.html").read_text()
    assert html_tables(committed_page) == html_tables(page(results, SECTIONS, tables, {}, []))
    assert len(html_tables(committed_page)) == len(shown)


def html_tables(text: str) -> list[str]:
    """The tables of a page, with the regions that they scroll in."""
    return re.findall(r"<div class='wide' role='region'.*?</table></div>", text)


def as_number(cell: str) -> object:
    """A number up to its last digits, which depend on the machine; or the word itself."""
    try:
        return pytest.approx(float(cell), rel=1e-9, abs=1e-12, nan_ok=True)
    except ValueError:
        return cell
