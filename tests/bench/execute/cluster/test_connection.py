"""Tests of the errors that keep this process from joining a cluster: each is said at once, and how to mend it."""

import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.execute.cluster import connection
from thalweg.bench.execute.cluster.connection import check_address, ray_connection
from thalweg.bench.execute.cluster.ray_executor import RayExecutor


@contextmanager
def port(*, listens: bool) -> Iterator[str]:
    """An address of this machine's at which nobody answers, or somebody who is no cluster."""
    with socket.socket() as place:
        place.bind(("127.0.0.1", 0))
        if listens:
            place.listen()
        yield f"127.0.0.1:{place.getsockname()[1]}"


@pytest.mark.parametrize(
    ("address", "message"),
    [
        ("ray://head:10001", "Ray's client is not supported. Run the command on a node of the cluster"),
        ("head", "--cluster head: give auto, or the head's address as HOST:PORT, such as 10.0.0.1:6379"),
        ("head:ray", "give auto"),
        ("head:65536", "give auto"),
        (":6379", "give auto"),
        ("http://head:8265", "give auto"),
        ("local", "give auto"),
    ],
)
def test_an_address_of_another_kind_is_refused(address: str, message: str):
    with pytest.raises(ResultsError, match=message):
        check_address(address)


@pytest.mark.parametrize("address", ["auto", "head:6379", "10.0.0.1:6379", "[::1]:6379"])
def test_the_addresses_of_heads_are_taken(address: str):
    assert check_address(address) is None


def test_without_ray_the_extra_is_named(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(ResultsError, match=r"--cluster needs Ray: .* pip install '\.\[cluster\]'"):
        RayExecutor("auto")


@pytest.mark.parametrize(("option", "number"), [("jobs", 0), ("cpus", 0)])
def test_no_runs_at_a_time_and_no_processors_are_refused(option: str, number: int):
    with pytest.raises(ResultsError, match=f"{option} must be at least 1, not 0"):
        RayExecutor("auto", **{option: number})


def test_the_lock_of_ray_pins_nothing_that_the_project_pins():
    root = Path(__file__).parents[4]
    pins = [
        {
            line.split("==")[0].lower().replace("_", "-")
            for line in (root / name).read_text().splitlines()
            if "==" in line
        }
        for name in ("requirements.lock", "requirements-cluster.lock")
    ]
    assert "ray" in pins[1] and not pins[0] & pins[1]


@pytest.mark.ray
def test_without_a_cluster_the_error_explains_how_to_start_one():
    message = "no cluster at {} .*refused.; start one with `ray start --head`, and `ray start --address=HOST:6379` on"
    with (
        port(listens=False) as address,
        pytest.raises(ResultsError, match=message.format(address)),
        ray_connection(address),
    ):
        pass


@pytest.mark.ray
def test_where_somebody_else_listens_it_is_given_up_in_time(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(connection, "ANSWER_S", 1.0)
    message = "the cluster at {} has not answered in 1 s. Is this the port of the head"
    with (
        port(listens=True) as address,
        pytest.raises(ResultsError, match=message.format(address)),
        ray_connection(address),
    ):
        pass
