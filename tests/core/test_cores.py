"""The number of cores that a process may use, under the limits of control groups of both versions."""

import os
from pathlib import Path

import pytest

from thalweg.core import cores as module


@pytest.mark.parametrize(
    ("lines", "files", "cores"),
    [
        ("0::/a/b", {"a/cpu.max": "150000 100000", "a/b/cpu.max": "max 100000"}, 2),
        ("0::/a/b", {"a/cpu.max": "150000 100000", "a/b/cpu.max": "50000 100000"}, 1),
        ("0::/", {"cpu.max": "300000 100000"}, 3),
        ("0::/../outside", {"cpu.max": "300000 100000"}, 3),
        ("0::/", {"cpu.max": "10000000 100000"}, 64),
        ("0::/", {"cpu.max": "damaged"}, 64),
        ("4:memory:/m\n3:cpu,cpuacct:/d", {"cpu,cpuacct/d/cpu.cfs_quota_us": "250000"}, 3),
        ("4:memory:/m\n3:cpu,cpuacct:/host", {"cpu,cpuacct/cpu.cfs_quota_us": "250000"}, 3),
        ("3:cpu,cpuacct:/d", {"cpu,cpuacct/d/cpu.cfs_quota_us": "-1"}, 64),
        ("3:cpuset:/d", {"cpuset/d/cpu.cfs_quota_us": "100000"}, 64),
    ],
)
def test_the_time_that_a_container_may_use_limits_the_cores(
    lines: str, files: dict[str, str], cores: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    (tmp_path / "proc" / "self").mkdir(parents=True)
    (tmp_path / "proc" / "self" / "cgroup").write_text(f"{lines}\n")
    for name, content in files.items():
        (file := tmp_path / "groups" / name).parent.mkdir(parents=True, exist_ok=True)
        file.write_text(f"{content}\n")
        file.with_name("cpu.cfs_period_us").write_text("100000\n")
    monkeypatch.setattr(module, "PROC", tmp_path / "proc")
    monkeypatch.setattr(module, "GROUPS", tmp_path / "groups")
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(64)), raising=False)
    assert module.usable_cores() == cores
