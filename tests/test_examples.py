"""The examples run as they stand, and so do the lines of Python in the README."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from thalweg.encoder import load_encoder
from thalweg.train import load_policy
from thalweg.train.observations import encoder_hash

ROOT = Path(__file__).resolve().parent.parent


def run(*arguments: str, cwd: Path) -> str:
    done = subprocess.run([sys.executable, *arguments], cwd=cwd, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
def test_the_pilot_of_the_example_saves_what_it_saw(tmp_path: Path):
    output = run(str(ROOT / "examples" / "fly.py"), "--steps", "20", cwd=tmp_path)
    assert output.startswith("20 steps, return 0.")
    assert (tmp_path / "flight.png").stat().st_size > 10_000


@pytest.mark.slow
def test_a_custom_river_is_rendered_and_flown(tmp_path: Path):
    output = run(str(ROOT / "examples" / "own_river.py"), cwd=tmp_path)
    assert output.startswith("own_river.png: Clover Brook, a loop of ")
    assert output.count("return 10.00, Success") == 4
    assert (tmp_path / "own_river.png").exists()


@pytest.mark.slow
def test_a_reach_of_the_cam_is_drawn_and_flown(tmp_path: Path):
    output = run(str(ROOT / "examples" / "real_river.py"), "--start-m", "700", "--length-m", "150", cwd=tmp_path)
    assert output.startswith("River Cam: 150 m, 13 to 15 m wide")
    assert "return 10.00, Success" in output
    assert (tmp_path / "real_river.png").stat().st_size > 100_000
    assert (tmp_path / "real_river.map.png").exists()


@pytest.mark.slow
def test_training_and_evaluating_by_example(tmp_path: Path):
    output = run(str(ROOT / "examples" / "train_and_evaluate.py"), "--steps", "2048", "--episodes", "2", cwd=tmp_path)
    assert re.search(r"Easy: return \d+\.\d\d ± \d+\.\d\d, cost \d\.\d\d", output)
    context = load_policy(tmp_path / "runs" / "example").about.context
    assert (context["level"], context["encoder"]) == ("Medium", encoder_hash(load_encoder()))
    again = [sys.executable, str(ROOT / "examples" / "train_and_evaluate.py"), "--steps", "4096"]
    refused = subprocess.run(again, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (refused.returncode, "Traceback" in refused.stderr) == (1, False)
    assert "steps is 2048 there and 4096 here. Choose another folder. --out names one.\n" in refused.stderr


def test_the_python_of_the_readme_runs(tmp_path: Path):
    (block,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), flags=re.DOTALL)
    assert len([line for line in block.splitlines() if line.strip()]) <= 7
    output = run("-c", block, cwd=tmp_path)
    assert re.fullmatch(r"reward \d\.\d\d, cost [\d.]+, visited \d\.\d% of the river\n", output)


@pytest.mark.slow
def test_the_custom_environment_of_the_docs_can_be_trained_on(tmp_path: Path):
    (block,) = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "training.md").read_text(), flags=re.DOTALL)
    output = run("-c", block, cwd=tmp_path)
    assert re.fullmatch(r"\d+ episodes, return \d+\.\d, cost \d+\.\d\n", output)
    assert (tmp_path / "runs" / "cartpole" / "policy.safetensors").exists()


def test_the_ros_2_node_compiles_and_says_that_no_robot_has_run_it():
    source = (ROOT / "examples" / "ros2_follow.py").read_text()
    compile(source, "ros2_follow.py", "exec")
    assert "no robot, and no ROS, has run it" in source


def test_every_example_is_tested():
    files = Path(__file__), Path(__file__).with_name("plugins.py")  # that of a plug-in is run by `test_extend.py`
    tested = {name for file in files for name in re.findall(r'"(\w+\.py)"', file.read_text())}
    assert {file.name for file in (ROOT / "examples").glob("*.py")} <= tested


@pytest.mark.slow
def test_the_figures_in_the_pages_are_those_that_were_measured(tmp_path: Path):
    run(str(ROOT / "benchmarks" / "write_figures.py"), "--check", cwd=tmp_path)


def test_every_example_for_another_library_is_run_by_its_tests():
    folder = ROOT / "examples" / "interop"
    tested = "".join(file.read_text() for file in (ROOT / "tests" / "interop").glob("test_*.py"))
    assert [file.name for file in folder.glob("*.py") if f'"{file.name}"' not in tested] == []
