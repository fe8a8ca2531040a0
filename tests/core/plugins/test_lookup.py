"""Tests of finding plug-ins in files and by entry points, and of what is said about those that are broken."""

import os
import re
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from tests.plugins import install, no_plugins  # noqa: F401  (a fixture)
from thalweg.core.plugins import lookup
from thalweg.core.plugins.record import PluginError, PluginWarning, check_record

pytestmark = pytest.mark.usefixtures("no_plugins")
GROUP = "thalweg.tasks"
RECORD = """
class Record:
    plugin_group = "thalweg.tasks"
    def __init__(self, name, version=1):
        self.name, self.version = name, version
"""


def write(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(textwrap.dedent(text))
    return path


def mine(folder: Path, more: str = 'PLUGIN = Record("Mine")\n') -> Path:
    return write(folder / "mine.py", RECORD + more)


def test_a_plugin_of_a_file_is_found_in_any_case_with_its_place(tmp_path: Path):
    file = mine(tmp_path)
    lookup.add_files([file])
    plugin = lookup.find(GROUP, "mine")
    assert plugin is not None
    assert (plugin.name, plugin.file, plugin.line) == ("Mine", file, 6)
    assert plugin.as_data() == {"version": 1, "source": plugin.source}
    assert re.fullmatch("[0-9a-f]{16}", plugin.source)
    assert lookup.names(GROUP) == ["Mine"]
    assert lookup.find("thalweg.encoders", "mine") is None


def test_a_process_that_is_started_later_finds_it_too(tmp_path: Path):
    lookup.add_files([mine(tmp_path)])
    code = f"from thalweg.core.plugins import lookup; print(lookup.find({GROUP!r}, 'Mine').source)"
    printed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    plugin = lookup.find(GROUP, "Mine")
    assert plugin is not None and printed.strip() == plugin.source


def test_a_path_that_the_list_of_files_would_cut_is_refused_by_its_name(tmp_path: Path):
    file = mine(tmp_path / f"at 12{os.pathsep}30")
    with pytest.raises(PluginError, match=rf"12{os.pathsep}30.mine\.py: a file of plug-ins must have a path without"):
        lookup.add_files([file])
    assert lookup.given_files() == []


def test_several_records_of_a_file_are_plugins_but_not_those_that_it_imports(tmp_path: Path):
    write(tmp_path / "other_records.py", RECORD + 'OTHER = Record("Other")\n')
    more = (
        'from other_records import OTHER\nFIRST = Record("First")\nSECOND: Record = Record("Second")\nAGAIN = FIRST\n'
    )
    lookup.add_files([mine(tmp_path, more)])
    assert lookup.names(GROUP) == ["First", "Second"]


def test_the_hash_covers_what_is_imported_from_beside_the_file_and_nothing_else(tmp_path: Path):
    file = mine(tmp_path, 'import os, part_of_mine.deep\nPLUGIN = Record("Mine")\n')
    write(tmp_path / "part_of_mine" / "__init__.py", "")
    deep = write(tmp_path / "part_of_mine" / "deep.py", "from . import deeper\n")
    deeper = write(tmp_path / "part_of_mine" / "deeper.py", "x = 1\n")
    unused = write(tmp_path / "unused.py", "x = 1\n")
    hashes = []
    for changed in (None, unused, deep, deeper):
        if changed is not None:
            changed.write_text(changed.read_text() + "y = 2\n")
        os.utime(file, ns=(len(hashes), len(hashes)))
        lookup.add_files([file])
        plugin = lookup.find(GROUP, "Mine")
        assert plugin is not None
        hashes.append(plugin.source)
    assert hashes[0] == hashes[1]
    assert len(set(hashes)) == 3
    file.write_bytes(file.read_bytes().replace(b"\n", b"\r\n"))
    plugin = lookup.find(GROUP, "Mine")
    assert plugin is not None and plugin.source == hashes[-1]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x = 1\n\ny = x +\n", "mine.py, line 3: invalid syntax; a plug-in is a file of Python"),
        ("x = 1\ny = z\n", "mine.py, line 2: NameError: name 'z' is not defined"),
        (
            "def f():\n    import nowhere_to_be_found\nf()\n",
            "mine.py, line 2: ModuleNotFoundError: No module named 'now",
        ),
        ("import json\njson.loads('{')\n", "mine.py, line 2: JSONDecodeError: Expecting property"),
        (
            "x = 1\n",
            "mine.py holds no plug-in: at its top level, assign a record such as PLUGIN = AlgorithmPlugin(...)",
        ),
        (
            "from thalweg.core.plugins.record import check_record\n\ncheck_record('thalweg.tasks', 'Mine', 0, ())\n",
            "mine.py, line 3: the task Mine has the version 0; state version=1, and raise it when results change",
        ),
    ],
)
def test_a_broken_file_is_named_with_its_line(tmp_path: Path, text: str, words: str):
    file = write(tmp_path / "mine.py", text)
    with pytest.raises(PluginError) as raised:
        lookup.add_files([file])
    assert words in str(raised.value) and str(raised.value).startswith(str(tmp_path))
    assert lookup.given_files() == []


def test_a_missing_file_is_named(tmp_path: Path):
    with pytest.raises(
        PluginError, match=r"there is no plug-in .*nowhere\.py: name a file of Python, such as mine\.py"
    ):
        lookup.add_files([tmp_path / "nowhere.py"])


def test_two_files_with_one_name_are_refused_and_both_are_named(tmp_path: Path):
    first, second = mine(tmp_path / "a"), mine(tmp_path / "b", '\nPLUGIN = Record("MINE")\n')
    words = rf"two plug-ins are the task MINE: {first}, line 6 .*, and {second}, line 7 .*; leave one out, or rename it"
    with pytest.raises(PluginError, match=words):
        lookup.add_files([first, second])
    assert lookup.names(GROUP) == []


@pytest.mark.parametrize(
    ("name", "version", "words"),
    [
        ("mine", 1, "the name of the task is 'mine'; it must begin with a capital letter"),
        ("My task", 1, "the name of the task is 'My task'"),
        ("RIVER", 1, "the task 'River' comes with the package; give yours another name, such as MyRIVER"),
        ("Mine", True, "the version True; state version=1"),
        ("Mine", "1", "the version '1'"),
    ],
)
def test_names_and_versions_are_checked(name: str, version: object, words: str):
    with pytest.raises(PluginError, match=re.escape(words)):
        check_record(GROUP, name, version, ["River"])


def test_an_entry_point_is_imported_only_when_its_name_is_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    write(tmp_path / "mine_installed.py", RECORD + 'PLUGIN = Record("Installed")\n')
    install(tmp_path, {GROUP: {"Installed": "mine_installed:PLUGIN", "Broken": "mine_broken:PLUGIN"}})
    monkeypatch.syspath_prepend(str(tmp_path))
    assert lookup.names(GROUP) == ["Installed", "Broken"]
    assert "mine_installed" not in sys.modules
    plugin = lookup.find(GROUP, "installed")
    assert plugin is not None and plugin.place == f"{tmp_path / 'mine_installed.py'}, line 6"
    words = (
        r"the entry point 'Broken' of mine 1\.0 \(mine_broken:PLUGIN\) cannot be loaded: ModuleNotFoundError: No module"
    )
    with pytest.raises(PluginError, match=words):
        lookup.find(GROUP, "Broken")
    with pytest.warns(PluginWarning, match="a plug-in is left out: the entry point 'Broken' of mine"):
        assert [each.name for each in lookup.every(GROUP)] == ["Installed"]


def test_an_entry_point_of_a_package_is_hashed_with_the_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    write(tmp_path / "mine_package" / "__init__.py", "")
    write(tmp_path / "mine_package" / "part.py", "x = 1\n")
    write(tmp_path / "mine_package" / "task.py", f"from mine_package import part\n{RECORD}PLUGIN = Record('Packed')\n")
    write(tmp_path / "beside.py", "")
    install(tmp_path, {GROUP: {"Packed": "mine_package.task:PLUGIN"}})
    monkeypatch.syspath_prepend(str(tmp_path))
    before = lookup.find(GROUP, "Packed")
    write(tmp_path / "mine_package" / "part.py", "x = 2\n")
    after = lookup.find(GROUP, "Packed")
    assert before is not None and after is not None and before.source != after.source


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (
            "mine_wrong:Record",
            r"mine_wrong\.py, line 1: the entry point 'Wrong' .* is a type; in the group thalweg\.tasks",
        ),
        ("mine_wrong:PLUGIN", r"mine_wrong\.py, line 6: .* is named 'Right'; give both the same name"),
        ("mine_wrong:NOTHING", "AttributeError: module 'mine_wrong' has no attribute 'NOTHING'"),
    ],
)
def test_an_entry_point_of_something_else_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, value: str, words: str
):
    write(tmp_path / "mine_wrong.py", RECORD + 'PLUGIN = Record("Right")\n')
    install(tmp_path, {GROUP: {"Wrong": value}})
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "mine_wrong", raising=False)
    with pytest.raises(PluginError, match=words):
        lookup.find(GROUP, "Wrong")


def test_an_entry_point_with_the_name_of_the_packages_own_is_refused_when_it_is_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    install(tmp_path, {GROUP: {"river": "mine:PLUGIN"}})
    monkeypatch.syspath_prepend(str(tmp_path))
    assert lookup.find(GROUP, "Portage", ["River", "Portage"]) is None
    with pytest.raises(PluginError, match="the task River comes with the package, and is also an entry point of mine"):
        lookup.find(GROUP, "River", ["River", "Portage"])


def test_a_file_that_is_also_installed_counts_once_and_another_one_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    file = write(tmp_path / "mine_twice.py", RECORD + 'PLUGIN = Record("Twice")\n')
    install(tmp_path, {GROUP: {"Twice": "mine_twice:PLUGIN"}})
    monkeypatch.syspath_prepend(str(tmp_path))
    lookup.add_files([file])
    assert lookup.find(GROUP, "Twice") is not None
    lookup.add_files([mine(tmp_path / "copy", 'PLUGIN = Record("Single")\n')])
    assert lookup.names(GROUP) == ["Twice", "Single"]
    monkeypatch.setenv(lookup.VARIABLE, "")
    lookup.add_files([mine(tmp_path / "other", 'PLUGIN = Record("Twice")\n')])
    with pytest.raises(
        PluginError, match=r"two plug-ins are the task Twice: .*--plugin.*entry point 'Twice' of mine 1\.0"
    ):
        lookup.find(GROUP, "Twice")
