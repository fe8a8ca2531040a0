"""Tests of what is released: wheel and sdist outside the repository, the README for an index, and the citation."""

import importlib.util
import os
import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).resolve().parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
BASE = "https://example.org/thalweg/v0.1.0/"
FLY = """
import gymnasium, thalweg
print(thalweg.__version__, thalweg.__file__)
env = gymnasium.make("thalweg/Easy-v0")
env.reset(seed=0)
print(env.step(env.unwrapped.pilot_action())[0].shape)
from thalweg.bench.packaged import PACKAGED_POLICY
from thalweg.encoder import load_encoder
from thalweg.train import load_policy
print(load_policy(PACKAGED_POLICY).about.context["observation"], load_encoder("geometry").about is not None)
"""


def build(hook: str, source: Path, out: Path, **environment: str) -> Path:
    """Run a hook of the build backend in a folder; returns what it has built."""
    code = f"import sys, setuptools.build_meta as backend; print(backend.{hook}(sys.argv[1]))"
    done = subprocess.run(
        [sys.executable, "-c", code, str(out)],
        cwd=source,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return out / done.stdout.splitlines()[-1]


@pytest.fixture(scope="module")
def released(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """An sdist of the repository, and a wheel that is built from it alone."""
    folder = tmp_path_factory.mktemp("released")
    copy = folder / "copy"
    copy.mkdir()
    for name in ("pyproject.toml", "setup.py", "MANIFEST.in", "README.md", "LICENSE", "CHANGELOG.md", "CITATION.cff"):
        (copy / name).write_bytes((ROOT / name).read_bytes())
    (copy / "thalweg").symlink_to(ROOT / "thalweg")
    sdist = build("build_sdist", copy, folder)
    with tarfile.open(sdist) as archive:
        archive.extractall(folder / "unpacked", filter="data")
    (source,) = (folder / "unpacked").iterdir()
    return sdist, build("build_wheel", source, folder, THALWEG_BASE_URL=BASE)


@pytest.mark.slow
def test_the_wheel_of_the_sdist_flies_outside_the_repository(released: tuple[Path, Path], tmp_path: Path):
    place = tmp_path / "site"
    with zipfile.ZipFile(released[1]) as wheel:
        wheel.extractall(place)
    environment = {**os.environ, "PYTHONPATH": str(place)}
    done = subprocess.run(
        [sys.executable, "-P", "-c", FLY], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    version, shape, loaded = done.stdout.splitlines()
    assert version == f"{PROJECT['version']} {place / 'thalweg' / '__init__.py'}"
    assert (shape, loaded) == ("(128, 128, 4)", "rgb+mask True")


def installed(environment: Path, wheel: Path, extras: str = "") -> Path:
    """Install a wheel, with the versions of requirements.lock for what it needs; returns the folder of commands."""
    commands = environment / "bin"
    if not environment.exists():
        subprocess.run([sys.executable, "-m", "venv", str(environment)], check=True)
    lock = ["--constraint", str(ROOT / "requirements.lock")]
    command = [str(commands / "python"), "-m", "pip", "install", "--quiet", *lock, f"{wheel}{extras}"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return commands


@pytest.mark.slow
def test_the_wheel_flies_in_a_new_environment_without_and_with_its_extras(released: tuple[Path, Path], tmp_path: Path):
    def run(*command: str) -> subprocess.CompletedProcess[str]:
        place = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
        return subprocess.run(command, cwd=tmp_path, env=place, capture_output=True, text=True, check=False)

    commands = installed(tmp_path / "new", released[1])
    python, thalweg = str(commands / "python"), str(commands / "thalweg")
    flown = run(python, "-c", FLY)
    assert flown.stdout.splitlines()[1:] == ["(128, 128, 4)"], flown.stderr
    assert "No module named 'torch'" in flown.stderr  # an environment needs none
    refused = run(thalweg, "evaluate", "packaged")
    assert refused.returncode == 2 and "tyro is not installed: install the extra [all]" in refused.stderr
    installed(tmp_path / "new", released[1], "[all]")
    flown = run(python, "-c", FLY)
    assert flown.stdout.splitlines()[1:] == ["(128, 128, 4)", "rgb+mask True"], flown.stderr
    for given in (["evaluate", "packaged", "--levels", "easy", "--episodes", "1"], ["export"], ["world", "--help"]):
        done = run(thalweg, *given)
        assert done.returncode == 0, done.stderr
    recorded = run(thalweg, "record", "packaged", "--episodes", "1", "--steps", "2", "--video", "--out", "recorded")
    assert recorded.returncode == 0, recorded.stderr


@pytest.mark.slow
def test_the_wheel_has_the_extras_types_and_the_readme_of_an_index(released: tuple[Path, Path]):
    with zipfile.ZipFile(released[1]) as wheel:
        names = wheel.namelist()
        metadata = wheel.read(next(name for name in names if name.endswith("/METADATA"))).decode()
        entries = wheel.read(next(name for name in names if name.endswith("/entry_points.txt"))).decode()
    assert set(re.findall(r"^Provides-Extra: (.*)$", metadata, re.M)) == set(PROJECT["optional-dependencies"])
    assert "thalweg/py.typed" in names and "thalweg = thalweg.cli.entry:main" in entries
    assert f"]({BASE}docs/images/flight.webp)" in metadata and "Description-Content-Type: text/markdown" in metadata
    assert not [name for name in names if not name.startswith(("thalweg/", "thalweg-"))]


@pytest.mark.slow
def test_the_sdist_has_the_licence_and_the_citation_and_no_tests(released: tuple[Path, Path]):
    with tarfile.open(released[0]) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert {"LICENSE", "CITATION.cff", "README.md", "thalweg/world/real/rivers/cam.geojson"} <= names
    assert not [name for name in names if name.startswith("tests")]


@pytest.fixture
def setup() -> Any:
    spec = importlib.util.spec_from_file_location("thalweg_setup", ROOT / "setup.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_links_of_the_readme_stay_relative_without_an_address(setup: Any):
    assert setup.readme("") == (ROOT / "README.md").read_text(encoding="utf-8")


def test_links_of_the_readme_lead_to_the_address_of_the_release(setup: Any):
    text = setup.readme(BASE)
    assert f"]({BASE}docs/images/frames.png)" in text and "](https://arxiv.org/abs/2409.08511)" in text
    assert re.findall(r"\]\((?!https://|#)[^)]*\)", text) == []


@pytest.mark.parametrize("address", ["example.org/thalweg", "http://example.org", "https://nowhere/thalweg"])
def test_an_address_that_is_none_is_refused(setup: Any, address: str):
    with pytest.raises(SystemExit, match=f"THALWEG_BASE_URL is '{address}'"):
        setup.readme(address)


def test_the_citation_is_that_of_the_project():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert (citation["version"], citation["license"]) == (PROJECT["version"], PROJECT["license"])
    assert citation["cff-version"] == "1.2.0" and [author["name"] for author in citation["authors"]]


def test_the_data_of_the_package_has_cards():
    cards = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "docs" / "cards").glob("*.md"))
    data = [path for ending in ("safetensors", "csv", "geojson") for path in (ROOT / "thalweg").rglob(f"*.{ending}")]
    assert len(data) >= 7
    assert [path.name for path in data if f"`{path.relative_to(ROOT).as_posix()}`" not in cards] == []
