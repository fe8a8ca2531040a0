"""Tests of the comparison with Safety-Gymnasium: arithmetic, errors of the set-up, and the pages."""

import ast
import importlib
import json
import stat
import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def scripts(monkeypatch: pytest.MonkeyPatch):
    """Imports a script of `benchmarks/`, which is no package, by its name."""
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    yield importlib.import_module
    for name in ("peer", "peer_setup", "peer_venv", "write_peer"):
        sys.modules.pop(name, None)


@pytest.fixture
def peer(scripts) -> ModuleType:
    return scripts("peer")


@pytest.fixture
def peer_setup(scripts) -> ModuleType:
    return scripts("peer_setup")


@pytest.fixture
def peer_venv(scripts) -> ModuleType:
    return scripts("peer_venv")


@pytest.fixture
def recipe(peer_setup: ModuleType):
    return peer_setup.RECIPE


@pytest.fixture
def pages(scripts, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """`write_peer.py`, with figures and pages in a folder of the test."""
    write_peer = scripts("write_peer")
    for name in ("README.md", "render.md"):
        (tmp_path / name).write_text("before\n<!-- peer -->\nold\n<!-- /peer -->\nafter\n")
    words = {tmp_path / "README.md": write_peer.section, tmp_path / "render.md": write_peer.sentence}
    monkeypatch.setattr(write_peer, "PAGES", words)
    monkeypatch.setattr(write_peer, "FIGURES", tmp_path / "peer.json")
    return write_peer


def line(side: str, kind: str, count: int, *rates: float) -> dict:
    return {"side": side, "kind": kind, "count": count, "reset_s": 0.25, "rates": list(rates)}


def record(peer: ModuleType) -> dict:
    """Figures as `peer.py` writes them; the peer's larger vector environment is its fastest way to step."""
    lines = [
        line("Thalweg", "frame", 1, 60.0, 60.0, 60.0),
        line("Thalweg", "one", 1, 50.0, 40.0, 60.0),
        line("Thalweg", "vector", 16, 600.0, 600.0, 1200.0),
        line("Safety-Gymnasium", "one", 1, 100.0, 100.0, 100.0),
        line("Safety-Gymnasium", "vector", 2, 90.0, 300.0, 90.0),
        line("Safety-Gymnasium", "vector", 4, 120.0, 150.0, 200.0),
        line("Safety-Gymnasium", "frame", 1, 20.0, 30.0, 40.0),
    ]
    return {
        "machine": {"cpu": "Abacus", "cores": 2, "memory_gib": 1, "system": "Linux"},
        "versions": {"python": "3.11"},
        "load_before": 0.1,
        "peer": {"python": "3.10", "safety-gymnasium": "1.0.0", "mujoco": "2.3.3"},
        "opengl": "MUJOCO_GL=osmesa: llvmpipe",
        "size": 128,
        "seconds": 4.0,
        "measurements": lines,
        "comparisons": peer.comparisons(lines),
    }


def fake_python(path: Path, script: str) -> Path:
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return path


def test_a_ratio_is_the_median_of_the_ratios_and_not_the_ratio_of_the_medians(peer: ModuleType):
    assert peer.ratio([6, 8, 10], [3, 1, 5]) == (2, 2, 8)  # of the medians: 8 / 3
    assert peer.ratio([40, 10, 20], [2, 1, 10]) == (10, 2, 20)


@pytest.mark.parametrize(("ours", "theirs"), [([], []), ([1.0], [1.0, 2.0])])
def test_a_ratio_needs_pairs(peer: ModuleType, ours: list, theirs: list):
    with pytest.raises(ValueError, match=f"not {len(ours)} and {len(theirs)}"):
        peer.ratio(ours, theirs)


def test_each_side_is_compared_by_its_fastest_line(peer: ModuleType):
    found = {one["what"]: (one["ratio"], one["least"], one["greatest"]) for one in record(peer)["comparisons"]}
    assert found == {
        "steps, one environment each": (0.5, 0.4, 0.6),
        "steps, each at its fastest": (5.0, 4.0, 6.0),  # against four: 150 a second in the median, two have 90
        "frames alone, one camera each": (2.0, 1.5, 3.0),
    }


def test_every_kind_has_both_sides_and_every_second_turn_is_reversed(peer: ModuleType):
    lines = peer.contenders(2)
    assert {(one.side, one.kind) for one in lines} == {(s, k) for s in (peer.PEER, peer.OURS) for k in peer.KINDS}
    assert [one.count for one in lines if one.kind == "vector"] == [2, 4, 16]
    assert peer.in_turns(lines, 0) == peer.in_turns(lines, 2) == lines
    assert peer.in_turns(lines, 1) == lines[::-1]


@pytest.mark.parametrize(("cores", "counts"), [(1, [2, 4]), (4, [4, 8]), (12, [12, 16]), (64, [16])])
def test_the_peer_has_one_or_two_processes_per_core_up_to_the_batch(peer: ModuleType, cores, counts):
    theirs = [one for one in peer.contenders(cores) if one.side == peer.PEER and one.kind == "vector"]
    assert [one.count for one in theirs] == counts


def test_the_script_of_a_side_is_valid_python_3_8():
    ast.parse((ROOT / "benchmarks" / "peer_side.py").read_text(), feature_version=(3, 8))


def test_the_error_for_a_missing_python_names_supported_versions(peer_venv: ModuleType, recipe):
    with pytest.raises(peer_venv.SetupError, match=r"needs Python 3.8, 3.9 or 3.10, and none .* no-such-python"):
        peer_venv.find_python(recipe, "no-such-python")


def test_the_error_for_an_unsupported_python_names_its_version(peer_venv: ModuleType, recipe, tmp_path: Path):
    new = fake_python(tmp_path / "python", "echo 3.11.7")
    with pytest.raises(peer_venv.SetupError, match=rf"{new} is Python 3\.11\.7"):
        peer_venv.find_python(recipe, str(new))


def test_the_newest_python_that_runs_is_found(
    peer_venv: ModuleType, recipe, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    fake_python(tmp_path / "python3.10", "exit 127")  # such as pyenv's for a version that is not chosen
    older = fake_python(tmp_path / "python3.9", "echo 3.9.18")
    fake_python(tmp_path / "python3.8", "echo 3.8.18")
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    assert peer_venv.find_python(recipe, None) == (str(older), "3.9.18")


def test_a_failed_virtual_environment_is_removed_and_its_error_is_shown(peer_venv: ModuleType, recipe, tmp_path: Path):
    base = fake_python(tmp_path / "python", 'mkdir -p "$3"; echo "No module named venv" >&2; exit 1')
    home = tmp_path / "cache" / "made"
    with pytest.raises(peer_venv.SetupError, match=r"-m venv .* failed:\nNo module named venv"):
        peer_venv.create_venv(recipe, str(base), home)
    assert list(home.parent.iterdir()) == []


def test_the_error_without_opengl_names_the_packages(peer_setup: ModuleType, tmp_path: Path):
    python = fake_python(tmp_path / "python", 'echo "cannot load $MUJOCO_GL" >&2; exit 1')
    with pytest.raises(peer_setup.SetupError) as error:
        peer_setup.backend(python)
    message = str(error.value)
    assert "MUJOCO_GL=egl: cannot load egl" in message and "MUJOCO_GL=osmesa: cannot load osmesa" in message
    assert "libosmesa6" in message and "libegl1 and libgl1-mesa-dri" in message


def test_software_rendering_is_preferred_to_a_graphics_card(peer_setup: ModuleType, tmp_path: Path):
    card = 'echo "\\"Some Card, OpenGL 4.6\\""'
    drawn = 'echo "\\"llvmpipe (LLVM), OpenGL 4.5\\""'
    python = fake_python(tmp_path / "python", f'if [ "$MUJOCO_GL" = osmesa ]; then {card}; else {drawn}; fi')
    assert peer_setup.backend(python) == ("egl", "llvmpipe (LLVM), OpenGL 4.5")
    with pytest.raises(peer_setup.SetupError, match="MUJOCO_GL=egl: Some Card"):
        peer_setup.backend(fake_python(tmp_path / "python", card))


def test_the_table_is_sorted_by_kind_with_the_peer_first(peer: ModuleType, scripts):
    rows = scripts("write_peer").table_rows(record(peer))
    assert rows[0] == ["steps, one environment", "Safety-Gymnasium", "1", "100", "100", "100"]
    assert rows[4] == ["steps, the vector environment", "Thalweg", "16", "600", "600", "1,200"]
    assert [row[1:3] for row in rows] == [
        *(["Safety-Gymnasium", "1"], ["Thalweg", "1"]),
        *(["Safety-Gymnasium", "2"], ["Safety-Gymnasium", "4"], ["Thalweg", "16"]),
        *(["Safety-Gymnasium", "1"], ["Thalweg", "1"]),
    ]
    assert rows[6] == ["frames alone, one camera", "Thalweg", "1", "60.0", "60.0", "60.0"]


def test_the_table_and_the_sentence_have_the_ratios(peer: ModuleType, scripts):
    write_peer = scripts("write_peer")
    assert write_peer.ratio_rows(record(peer))[1] == ["steps, each at its fastest", "5.00", "4.00", "6.00"]
    text = " ".join(write_peer.sentence(record(peer)).split())
    assert "0.50 times (0.40 to 0.60) its steps a second with one environment each, 5.00 times (4.00 to 6.00)" in text


def test_sections_are_written_between_their_comments_and_writing_again_changes_nothing(pages, peer, tmp_path: Path):
    (tmp_path / "peer.json").write_text(json.dumps(record(peer)))
    assert pages.main([]) == 0
    first = [page.read_text() for page in pages.PAGES]
    assert all(text.startswith("before\n<!-- peer -->\n") for text in first)
    assert all(text.endswith("\n<!-- /peer -->\nafter\n") and "old" not in text for text in first)
    assert "| steps, each at its fastest | 5.00 | 4.00 | 6.00 |" in first[0]
    assert pages.main([]) == 0
    assert [page.read_text() for page in pages.PAGES] == first
    assert pages.main(["--check"]) == 0


def test_the_check_fails_for_an_outdated_page_and_leaves_it_unchanged(pages, peer, tmp_path: Path, capsys):
    figures = record(peer)
    (tmp_path / "peer.json").write_text(json.dumps(figures))
    pages.main([])
    figures["load_before"] = 9.9  # stands in the longer page only
    (tmp_path / "peer.json").write_text(json.dumps(figures))
    old = (tmp_path / "README.md").read_text()
    assert pages.main(["--check"]) == 1
    assert capsys.readouterr().err.endswith("writes them: README.md\n")
    assert (tmp_path / "README.md").read_text() == old


def test_pages_without_figures_say_so(pages, tmp_path: Path):
    assert pages.main([]) == 0
    assert "<!-- peer -->\nNot measured yet.\n<!-- /peer -->" in (tmp_path / "render.md").read_text()


@pytest.mark.parametrize("text", ["", "{b}x", "x{e}", "{b}x{e}{b}x{e}", "{e}x{b}x{e}"])
def test_a_page_without_one_pair_of_comments_is_an_error(scripts, text: str):
    write_peer = scripts("write_peer")
    with pytest.raises(ValueError, match="one pair of marks"):
        write_peer.replace_section(text.format(b="<!-- peer -->\n", e="<!-- /peer -->"), "peer", "new")


def test_the_committed_pages_are_up_to_date(scripts):
    assert scripts("write_peer").main(["--check"]) == 0
