"""Tests that environments need no optional dependency, and that errors name the extra which installs a missing one."""

import importlib.metadata
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import thalweg
from thalweg.core.extras import EXTRAS, advice_for, how_to_install
from thalweg.world import World

ROOT = Path(__file__).resolve().parent.parent
HEAVY = ["numba", "llvmlite", "scipy", "pydantic", "PIL", "safetensors", "yaml", "email", "importlib.metadata"]
"""What `import thalweg` must not import beside the optional modules, so that it takes a third of a second."""
OPTIONAL = sorted({module for modules in EXTRAS.values() for module in modules})
WITHOUT = """
import sys
from importlib.machinery import PathFinder
class Rest(PathFinder):
    @classmethod
    def find_spec(cls, name, path=None, target=None):
        return None if name.partition(".")[0] in {missing!r} else super().find_spec(name, path, target)
sys.meta_path = [Rest if finder is PathFinder else finder for finder in sys.meta_path]
{code}
"""


def run_without(
    missing: list[str], code: str, *arguments: str, cwd: Path | None = None
) -> subprocess.CompletedProcess[str]:
    """Run code in a process in which some modules are not installed."""
    command = [sys.executable, "-c", WITHOUT.format(missing=missing, code=code), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=cwd)


ENVIRONMENTS = """
import gymnasium, thalweg
from thalweg.render import Camera
env = gymnasium.make("thalweg/Easy-v0", camera=Camera(32, 32))
envs = gymnasium.make_vec("thalweg/Easy-v0", num_envs=2, camera=Camera(32, 32), observation="mask")
for each, action in ((env, env.action_space.sample()), (envs, envs.action_space.sample())):
    each.reset(seed=0)
    print(each.step(action)[0].shape)
"""


def test_environments_fly_where_no_extra_is_installed(easy_world: World):
    ended = run_without(OPTIONAL, ENVIRONMENTS)
    assert (ended.stdout, ended.returncode) == ("(32, 32, 4)\n(2, 32, 32, 1)\n", 0), ended.stderr


def test_the_import_of_the_package_and_a_new_environment_load_nothing_heavy(easy_world: World):
    code = f"""
import sys, gymnasium, thalweg
print([name for name in {[*OPTIONAL, *HEAVY]!r} if name in sys.modules])
gymnasium.make("thalweg/Easy-v0", observation="none")
print([name for name in {OPTIONAL!r} if name in sys.modules])
"""
    assert run_without([], code).stdout == "[]\n[]\n"


SCRIPT = "import sys\nfrom thalweg.cli.entry import main\nsys.exit(main())"


@pytest.mark.parametrize(
    ("missing", "arguments", "told"),
    [
        (OPTIONAL, ["--version"], "tyro is not installed: install the extra [all], in a clone"),
        (["matplotlib"], ["world"], "matplotlib is not installed: install the extra [all], in"),
        (["torch"], ["train", "--out", "x"], "torch is not installed: install the extra [all], in"),
    ],
)
def test_a_command_names_the_extra_that_it_needs(missing: list[str], arguments: list[str], told: str):
    ended = run_without(missing, SCRIPT, *arguments)
    assert (ended.returncode, ended.stdout) == (2, "")
    assert ended.stderr.startswith(f"thalweg: {told}") and ended.stderr.count("\n") == 1


def declared() -> dict[str, list[str]]:
    """Return the requirements of each extra in the project's file."""
    return tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]


def modules_of(extra: str) -> set[str]:
    """Return the optional modules that an extra installs, those of the extras that it names included."""
    others = [name for each in declared()[extra] if each.startswith("thalweg[") for name in each[8:-1].split(",")]
    return set(EXTRAS[extra]).union(*(modules_of(other) for other in others))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("extra", "arguments", "status", "told"),
    [
        (
            "record",
            ["record", "packaged", "--level", "easy", "--episodes", "1", "--steps", "2", "--size", "32"],
            0,
            "1 flights",
        ),
        ("export", ["export", "--out", "policy.onnx"], 0, "acts as the policy does"),
        # The policy is loaded before the page is served, at an address of documents that no machine has.
        ("viewer", ["fly", "packaged", "--level", "easy", "--host", "192.0.2.1"], 2, "of 192.0.2.1 cannot be used"),
    ],
)
def test_an_extra_brings_all_that_its_command_needs(
    extra: str, arguments: list[str], status: int, told: str, tmp_path: Path, easy_world: World
):
    missing = sorted(set(OPTIONAL) - modules_of(extra))
    ended = run_without(missing, SCRIPT, *arguments, cwd=tmp_path)
    assert (ended.returncode, told in ended.stdout + ended.stderr) == (status, True), ended.stderr


@pytest.mark.parametrize(
    ("module", "advice"),
    [
        ("ray", f"ray is not installed: {how_to_install('cluster')}"),
        ("torch.utils", f"torch is not installed: {how_to_install('all')}"),
        ("mine", None),
    ],
)
def test_advice_names_the_extra_of_a_module(module: str, advice: str | None):
    assert advice_for(ModuleNotFoundError(name=module)) == advice


def test_the_command_that_installs_an_extra_works_in_a_clone_and_needs_no_package_index_to_know_the_project():
    assert how_to_install("geo") == "install the extra [geo], in a clone of Thalweg by: pip install '.[geo]'"


def test_errors_name_extras_that_exist_and_take_the_command_from_one_place():
    sources = {path: path.read_text() for path in [*ROOT.glob("thalweg/**/*.py"), *ROOT.glob("examples/**/*.py")]}
    named = {extra for text in sources.values() for extra in re.findall(r"""how_to_install\(["'](\w+)["']\)""", text)}
    assert {"geo", "cuda", "cluster", "sb3"} <= named <= set(declared())
    commands = {path.relative_to(ROOT).as_posix() for path, text in sources.items() if "pip install 'thalweg" in text}
    assert commands == set()


def test_the_extras_are_those_of_the_projects_file():
    own = {"thalweg", "numpy"}  # NumPy is in no extra but to be held below a version
    names = {
        extra: {re.split(r"[\[<>=]", requirement)[0].replace("-", "_") for requirement in declared()[extra]} - own
        for extra in EXTRAS
    }
    assert names == {extra: set(modules) - {"cuda"} for extra, modules in EXTRAS.items()}
    assert declared()["all"] == ["thalweg[learn,cli,plot,film,geo,viewer,record,export]"]


def test_an_extra_installs_nothing_that_the_package_does_not_name():
    sources = "".join(path.read_text() for path in ROOT.glob("thalweg/**/*.py") if path.name != "extras.py")
    behind = {"onnxscript"}  # PyTorch's exporter imports it
    assert [name for name in OPTIONAL if not re.search(rf"(?<![\w-]){name}(?![\w-])", sources)] == sorted(behind)


def test_the_version_is_that_of_the_installation():
    assert thalweg.__version__ == importlib.metadata.version("thalweg")


@pytest.mark.parametrize(
    ("extras", "modules"),
    [
        ("learn,cli", "thalweg.cli.tables, thalweg.cli.evaluate, thalweg.bench.evaluate.evaluation"),
        ("learn,cli,film", "thalweg.viewer.flight.filming, thalweg.bench.pictures.film"),
    ],
)
def test_commands_of_the_readme_need_no_more_than_the_extras_that_it_names(extras: str, modules: str):
    brought = {module for extra in extras.split(",") for module in EXTRAS[extra]}
    ended = run_without([module for module in OPTIONAL if module not in brought], f"import {modules}")
    assert ended.returncode == 0, ended.stderr
