"""The encoder study, small: it measures what it says, goes on where it was killed, and refuses what is not its own."""

import csv
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.studies import encoder_study
from thalweg.bench.studies.encoder_study import (
    CASES,
    COMPARED,
    MEASURES,
    SIZES,
    Scenes,
    StudyConfig,
    measures,
    read_measures,
    run_study,
)
from thalweg.bench.studies.encoder_tables import PROBED, SIZE_COLUMNS, Case
from thalweg.encoder import load_encoder
from thalweg.encoder.training import split_indices

SMALL = StudyConfig(
    "Easy", images=40, held_out=8, epochs=2, precision="float32", cases=(*COMPARED, Case("rgb+mask", 8))
)


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("study") / "encoders"
    run_study(folder, SMALL, progress=False)
    return folder


def rows(path: Path) -> list[dict[str, str]]:
    with open(path) as file:
        return list(csv.DictReader(file))


def test_what_the_study_compares():
    sizes = [case.latent for case in CASES if (case.architecture, case.inputs) == ("lean", "rgb+mask")]
    assert sorted(sizes) == sorted(SIZES) and len(set(CASES)) == len(CASES) == 12
    assert {case.latent for case in CASES if case.architecture == "paper"} == {16, 64}


@pytest.mark.slow
def test_every_case_has_a_row_and_no_number_that_its_input_can_not_have(study: Path):
    found = rows(study / "sizes.csv")
    assert [(row["inputs"], row["numbers"]) for row in found] == [
        ("rgb", "16"),
        ("mask", "16"),
        ("rgb+mask", "16"),
        ("rgb+mask", "8"),
    ]
    assert list(found[0]) == list(SIZE_COLUMNS)
    assert found[0]["iou_mask"] == "" and found[1]["iou_colours"] == "" and found[2]["iou_mask"] != ""
    for row in found:
        assert float(row["train_mse"]) > 0 and float(row["held_out_mse"]) > 0 and 0 <= float(row["iou_ceiling"]) <= 1
        assert all(float(row[f"read_{name}"]) <= 1 for name in ("height", "left_bank"))


@pytest.mark.slow
def test_the_encoders_of_the_package_are_probed_on_the_same_frames(study: Path):
    found = rows(study / "packaged.csv")
    numbers = {"default": "16", "geometry": "32", "geometry-tasks": "32"}
    assert {row["encoder"]: row["numbers"] for row in found} == numbers
    assert all(float(row["read_height"]) <= 1 for row in found)
    assert "packaged" not in (study / "sizes.csv").read_text()
    assert "The same for the encoders that come with the package" in (study / "study.md").read_text()


def test_codes_that_are_the_truths_are_read_without_error(monkeypatch: pytest.MonkeyPatch):
    truths = np.random.default_rng(0).normal(3.0, 2.0, (60, len(PROBED)))
    frames = np.zeros((60, 2, 2, 4), np.uint8)
    frames[:, 0, 0, 0] = np.arange(60)
    frames[::2, ..., 3] = 255

    def water(_: object, given: np.ndarray) -> np.ndarray:
        return np.ones(given.shape[:3], bool)

    class Told:
        """An encoder whose codes are the truths of its frames."""

        inputs, vae = "mask", None

        def __call__(self, seen: np.ndarray) -> np.ndarray:
            return truths[seen[:, 0, 0, 0]]

    encoder: Any = Told()
    segmenter: Any = None
    monkeypatch.setattr(encoder_study, "reconstruct", lambda _, seen: seen[..., 3:] / 255.0)
    monkeypatch.setattr(encoder_study, "water_in", water)
    train, held_out = np.arange(40), np.arange(40, 60)
    found = measures(encoder, segmenter, Scenes(frames, truths), train, held_out)
    assert list(found["read"]) == list(PROBED)
    assert [*found["read"].values()] == pytest.approx([1.0] * len(PROBED))
    assert (found["iou_mask"], found["iou_colours"], found["iou_ceiling"]) == (1.0, None, pytest.approx(0.5))


def test_errors_are_those_of_the_encoders_own_files(study: Path):
    about = load_encoder(study / "lean-rgb-mask-8" / "encoder.safetensors").about
    assert rows(study / "sizes.csv")[3]["held_out_mse"] == f"{about['held_out_mse']:.5f}"


def test_entropies_stand_beside_the_papers(study: Path):
    found = {(row["first"], row["second"]): row for row in rows(study / "entropy.csv")}
    assert len(found) == 6 and found["rgb+mask", "mask"]["paper"] == "0.187"
    assert all(float(row["smoothing_1e-06"]) >= float(row["smoothing_0.001"]) > 0 for row in found.values())


def test_the_page_and_the_figures_are_there(study: Path):
    page = (study / "study.md").read_text()
    assert "40 frames of Easy" in page and "relative entropy" in page.lower() and "R²" in page
    assert all((study / name).stat().st_size > 5000 for name in ("sizes.png", "inputs.png"))


@pytest.mark.slow
def test_finished_work_is_not_repeated_and_killed_work_resumes(
    study: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    folder = tmp_path / "cut"
    train, trained = encoder_study.train_encoder, []
    find, found = encoder_study.train_segmenter, []

    def killed(*args, **kwargs):
        trained.append(args[2].name)
        if len(trained) == 2:
            raise KeyboardInterrupt
        return train(*args, **kwargs)

    monkeypatch.setattr(encoder_study, "train_encoder", killed)
    monkeypatch.setattr(encoder_study, "train_segmenter", lambda *args, **how: found.append(how) or find(*args, **how))
    with pytest.raises(KeyboardInterrupt):
        run_study(folder, SMALL, progress=False)
    assert (folder / "lean-rgb-16" / MEASURES).exists() and not (folder / "study.md").exists()
    run_study(folder, SMALL, progress=False)
    assert trained == ["lean-rgb-16", "lean-mask-16", "lean-mask-16", "lean-rgb-mask-16", "lean-rgb-mask-8"]
    assert len(found) == 1
    assert (folder / "entropy.csv").read_text() == (study / "entropy.csv").read_text()
    for cut, whole in zip(rows(folder / "sizes.csv"), rows(study / "sizes.csv"), strict=True):
        for name in SIZE_COLUMNS[2:]:  # regressions on so few images magnify the last bits
            assert cut[name] == whole[name] or float(cut[name]) == pytest.approx(float(whole[name]), abs=0.01), name


def test_a_folder_that_another_command_holds_is_refused(study: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("thalweg.core.run_folder.WAIT_S", 0.1)
    with encoder_study.STUDY_FOLDER.locked(study), pytest.raises(ResultsError, match=re.escape(str(study))):
        run_study(study, SMALL, progress=False)


def test_a_folder_of_another_study_is_refused_with_the_difference(
    study: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    with pytest.raises(ResultsError, match=r"epochs is 2 there and 3 here"):
        run_study(study, replace(SMALL, epochs=3), progress=False)
    with pytest.raises(ResultsError, match="precision is 'float32' there and 'bfloat16' here"):
        run_study(study, replace(SMALL, precision="bfloat16"), progress=False)
    monkeypatch.setattr(encoder_study.versions, "WORLD", 99)
    with pytest.raises(ResultsError, match=r"versions\.world is \d+ there and 99 here"):
        run_study(study, SMALL, progress=False)
    (tmp_path / "letter.txt").write_text("mine")
    with pytest.raises(ResultsError, match=r"holds letter\.txt, but no study\.json: it is not the folder of a study"):
        run_study(tmp_path, SMALL, progress=False)


def test_a_study_resumes_in_the_precision_it_started_with(study: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(encoder_study, "resolve_precision", lambda asked: "bfloat16")
    page = (study / "study.md").read_text()
    run_study(study, replace(SMALL, precision="auto"), progress=False)
    assert (study / "study.md").read_text() == page and "2 epochs in float32" in page


def test_a_study_has_the_precision_that_is_faster_where_it_begins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    asked = []

    def killed(*args, precision: str, **kwargs):
        asked.append(precision)
        raise KeyboardInterrupt

    monkeypatch.setattr(encoder_study, "resolve_precision", lambda asked: "bfloat16")
    monkeypatch.setattr(encoder_study, "train_encoder", killed)
    with pytest.raises(KeyboardInterrupt):
        run_study(tmp_path / "new", replace(SMALL, precision="auto"), progress=False)
    assert asked == ["bfloat16"]


def test_an_unknown_precision_is_refused_with_the_known_ones():
    with pytest.raises(ResultsError, match="unknown precision 'half'; known: auto, float32, bfloat16"):
        replace(SMALL, precision="half")


def test_images_held_out_are_never_trained_on():
    train, held_out = split_indices(10, 3, 0)
    assert len(held_out) == 3 and sorted([*train, *held_out]) == list(range(10))
    assert np.array_equal(split_indices(10, 3, 0)[1], held_out)


MEASURED = {
    **dict.fromkeys(("train_mse", "held_out_mse", "mean_image_mse", "iou_mask", "iou_ceiling"), 0.5),
    "iou_colours": None,
    "read": dict.fromkeys(("left bank", "right bank", "heading error", "height", "bridge"), 0.25),
}


def test_measures_are_read_as_they_were_written(tmp_path: Path):
    (tmp_path / "measures.json").write_text(json.dumps(MEASURED))
    assert read_measures(tmp_path / "measures.json") == MEASURED


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("[" * 50_000, "can't be read"),
        ("[1]", r"a mapping is needed, not \[1\]"),
        (json.dumps(MEASURED | {"train_mse": 10**400}), "train_mse is 1000"),
        (json.dumps(MEASURED | {"train_mse": "low"}), "train_mse is 'low'; a number or null is needed"),
        (json.dumps({name: value for name, value in MEASURED.items() if name != "iou_mask"}), "iou_mask is missing"),
        (json.dumps(MEASURED | {"read": [1]}), "read.left bank is missing"),
    ],
)
def test_other_measures_are_refused_by_name(content: str, words: str, tmp_path: Path):
    (tmp_path / "measures.json").write_text(content)
    with pytest.raises(ResultsError, match=rf"(?s)measures\.json .*{words}"):
        read_measures(tmp_path / "measures.json")
