"""The kinds of files that are fuzzed: valid samples, their mutation, their reader, and what a right answer is.

A reader may raise the project's own errors with the file's name, or return a value that holds no number that is not
finite. Samples are files that the package wrote, or short ones in the formats that others write. Kinds of runs in
progress, of whole results and of recordings stand in modules of their own.
"""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
import yaml
from kind import Kind, written
from mutations import (
    mutated_json,
    mutated_npz,
    mutated_safetensors,
    mutated_table,
    mutated_xml,
    mutated_yaml,
)

REPOSITORY = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(REPOSITORY))  # the files of earlier versions are part of the tests

from recording_kinds import RECORDING_KINDS  # noqa: E402
from result_kinds import RESULT_KINDS  # noqa: E402
from run_kinds import RUN_KINDS  # noqa: E402

from tests.env import handmade  # noqa: E402
from tests.world.lines import circle, course  # noqa: E402
from thalweg.algos.common.errors import AlgorithmError  # noqa: E402
from thalweg.algos.policy.policy_file import load_policy  # noqa: E402
from thalweg.bench.csv_files import ResultsError  # noqa: E402
from thalweg.bench.evaluate.episodes import read_episodes  # noqa: E402
from thalweg.bench.results.curve import CURVE, read_training  # noqa: E402
from thalweg.bench.results.results import RunRow, read_runs  # noqa: E402
from thalweg.bench.results.run_versions import read_versions  # noqa: E402
from thalweg.bench.suite.builtin import SUITES, load_suite  # noqa: E402
from thalweg.bench.suite.record import arms_of, read_suite  # noqa: E402
from thalweg.encoder import EncoderFileError, EncoderInputError, load_encoder  # noqa: E402
from thalweg.encoder.files import save_geometry, save_vae  # noqa: E402
from thalweg.encoder.geometry import GeometryConfig, GeometryNetwork  # noqa: E402
from thalweg.encoder.vae import VAE, VAEConfig  # noqa: E402
from thalweg.train.errors import TrainingError  # noqa: E402
from thalweg.train.folder.checkpoint import load_checkpoint  # noqa: E402
from thalweg.train.folder.run_record import read_config, read_status  # noqa: E402
from thalweg.viewer.errors import ViewerError  # noqa: E402
from thalweg.viewer.flight.options import FlightOptions  # noqa: E402
from thalweg.viewer.flight.recording import KEPT, Recording, read_recording, write_recording  # noqa: E402
from thalweg.world import World, WorldError  # noqa: E402
from thalweg.world.real.file_river import plan_file  # noqa: E402
from thalweg.world.real.selection import Selection  # noqa: E402

SAVED = REPOSITORY / "tests" / "saved_files" / "written_by_0_1_0"
TINY = REPOSITORY / "tests" / "bench" / "tiny_results"
LINE = [[7.0, 45.0, 10.0], [7.0005, 45.0001, 9.8], [7.001, 45.0, 9.7], [7.0015, 45.0003, 9.5], [7.002, 45.0, 9.0]]
BANKS = [[[7.0, 44.9999], [7.002, 44.9999], [7.002, 45.0001], [7.0, 45.0001], [7.0, 44.9999]]]
ISLE = [[[7.0010, 44.99999], [7.00105, 44.99999], [7.00105, 45.00001], [7.0010, 45.00001], [7.0010, 44.99999]]]


def _feature(kind: str, coordinates: Any, **properties: Any) -> dict:
    return {"type": "Feature", "properties": properties, "geometry": {"type": kind, "coordinates": coordinates}}


def _geojson(folder: Path) -> list[bytes]:
    flat = [place[:2] for place in LINE]
    loop = [[7 + 0.001 * np.cos(a), 45 + 0.0007 * np.sin(a)] for a in np.linspace(0, 2 * np.pi, 24)]
    loop[-1] = loop[0]
    bridge = _feature("LineString", [[7.0007, 44.9998], [7.0007, 45.0003]], highway="footway", bridge="yes")
    trees = (
        _feature("LineString", LINE, width_m=12, name="Elde"),
        {
            "type": "FeatureCollection",
            "features": [_feature("LineString", flat, width="14 m", waterway="river"), bridge],
        },
        _feature("MultiLineString", [flat[:3], flat[2:]], width_m=9.5),
        {
            "type": "FeatureCollection",
            "features": [
                _feature("Polygon", BANKS, natural="water"),
                _feature("Polygon", ISLE, place="islet"),
                _feature("LineString", [[7.0, 45.0], [7.002, 45.0]], waterway="river"),
            ],
        },
        _feature("LineString", loop, width_m=[10.0] * len(loop)),
    )
    return [json.dumps(tree).encode() for tree in trees]


def _overpass(folder: Path) -> list[bytes]:
    geometry = [{"lat": place[1], "lon": place[0]} for place in LINE]
    ring = [{"lat": place[1], "lon": place[0]} for place in BANKS[0]]
    way = {"type": "way", "id": 1, "tags": {"waterway": "river", "width": "12"}, "geometry": geometry}
    member = {"type": "way", "ref": 3, "role": "outer", "geometry": ring}
    banks = {"type": "relation", "id": 2, "tags": {"type": "multipolygon", "natural": "water"}, "members": [member]}
    node = {"type": "node", "id": 4, "lat": 45.0, "lon": 7.0}
    return [json.dumps({"version": 0.6, "elements": each}).encode() for each in ([way, node], [banks], [way, banks])]


def _gpx(folder: Path) -> list[bytes]:
    points = "".join(f'<trkpt lat="{y}" lon="{x}"><ele>{z}</ele></trkpt>' for x, y, z in LINE)
    head = '<gpx version="1.1" creator="me" xmlns="http://www.topografix.com/GPX/1/1">'
    return [f"{head}<trk><name>Elde</name><trkseg>{points}</trkseg></trk></gpx>".encode()]


def _kml(folder: Path) -> list[bytes]:
    places = " ".join(f"{x},{y},{z}" for x, y, z in LINE)
    data = '<ExtendedData><Data name="width"><value>12 m</value></Data></ExtendedData>'
    line = f"<LineString><altitudeMode>absolute</altitudeMode><coordinates>{places}</coordinates></LineString>"
    ring = " ".join(f"{x},{y}" for x, y in BANKS[0])
    outer = f"<outerBoundaryIs><LinearRing><coordinates>{ring}</coordinates></LinearRing></outerBoundaryIs>"
    polygon = f"<Polygon>{outer}</Polygon>"
    head, tail = '<kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark>', "</Placemark></Document></kml>"
    return [f"{head}<name>Elde</name>{data}{each}{tail}".encode() for each in (line, polygon)]


def _read_river(path: Path) -> Any:
    """Return the plan of a river's file; a width is given, as most files have none."""
    plan = plan_file(path, Selection(width_m=12.0))
    return plan.name, plan.notes, plan.river, plan.solids.islands, plan.solids.bridges


def _suites(folder: Path) -> list[bytes]:
    mine = b"arms:\n  - {algorithm: FOCOPS, seeds: [0, 1], steps: 5e4, settings: {cost_limit: 0.05}, name: strict}\n"
    mine += b"test_levels: [Easy, Medium]\nconditions: [unseen, real]\nworld_seeds: [1, '1000:1016']\n"
    others = [{**SUITES[name].as_data(), "conditions": ["unseen"]} for name in ("quick", "protocols", "swimmers")]
    return [mine, *(yaml.safe_dump(other).encode() for other in others)]


def _worlds(folder: Path) -> list[bytes]:
    loop = World.from_centerline(course(circle(10.0, 24), 4.0), plants=False, seed=4)
    return [(SAVED / "world.npz").read_bytes(), written(folder, "a.npz", loop.save)]


def _encoders(folder: Path) -> list[bytes]:
    torch.manual_seed(0)
    vae = VAE(VAEConfig(inputs="mask", latent=2, size_px=64)).eval()
    network = GeometryNetwork(GeometryConfig(targets=("height", "bank"), latent=2, hidden=8, size_px=64)).eval()
    about = {"render_version": 1, "images": 10}
    return [
        written(folder, "a.safetensors", lambda path: save_vae(path, vae, about)),
        written(folder, "a.safetensors", lambda path: save_geometry(path, network, about)),
    ]


def _read_encoder(path: Path) -> Any:
    """Return the code of a grey frame, and the description."""
    encoder = load_encoder(path)
    size = encoder.config.size_px
    return encoder(np.full((1, size, size, 4), 128, np.uint8)), encoder.about


def _policies(folder: Path) -> list[bytes]:
    return [path.read_bytes() for path in sorted((SAVED / "policies").glob("*.safetensors"))]


def _read_policy(path: Path) -> Any:
    """Return the action of a policy."""
    policy = load_policy(path)
    player = policy.player(1, generator=torch.Generator().manual_seed(0))
    return player(np.zeros((1, policy.obs_size), np.float32), np.ones(1, bool))


def _flights(folder: Path) -> list[bytes]:
    steps, found = 4, []
    for options, actions in (
        (FlightOptions(), np.ones((steps, 4), np.int64)),
        (FlightOptions(action="continuous", task="Swimmers"), np.zeros((steps, 4), np.float32)),
    ):
        flight = Recording(
            options,
            ("pilot",) * steps,
            ("tight", "loose"),
            dict(KEPT),
            actions,
            np.zeros((steps + 1, 4)),
            np.arange(steps + 1.0),
            np.ones(steps),
            np.zeros((steps, 2)),
            progress=0.1,
            reason=0,
            ahead=float("nan"),
            world=1,
        )
        found.append(written(folder, "a.npz", lambda path, flight=flight: write_recording(path, flight)))
    return found


def _read_flight(path: Path) -> Any:
    """Return a recorded flight, and its row in a table."""
    flight = read_recording(path)
    return flight, flight.episode(0, handmade.ring())


def _checkpoint(part: str) -> Callable[[Path], list[bytes]]:
    folder = max((SAVED / "run" / "checkpoints").glob("[0-9]*"))
    return lambda _: [(folder / part).read_bytes()]


def _read_checkpoint(part: str) -> Callable[[Path], Any]:
    """Return a reader of a checkpoint of which one part is the file."""
    other = "state.json" if part == "arrays.safetensors" else "arrays.safetensors"

    def read(path: Path) -> Any:
        folder = path.parent / "checkpoints" / "000000000001"
        folder.mkdir(parents=True, exist_ok=True)
        (folder / part).write_bytes(path.read_bytes())
        (folder / other).write_bytes(_checkpoint(other)(path)[0])
        step, state = load_checkpoint(path.parent) or (0, {})
        return step, len(state)  # a state may hold NaN

    return read


def _read_record(path: Path) -> Any:
    """Return the checked part of a suite's record: settings may be infinite."""
    return [(arm["name"], arm["steps"], arm["seeds"]) for arm in arms_of(read_suite(path.parent))]


TRAINED = RunRow("PPO-0", "train", "PPO", 0, 400, "finished", "", 1.0, 400.0)
RIVER = (WorldError,)
KINDS: dict[str, Kind] = {
    "geojson": Kind("river.geojson", _geojson, mutated_json, _read_river, RIVER),
    "overpass": Kind("river.json", _overpass, mutated_json, _read_river, RIVER),
    "gpx": Kind("river.gpx", _gpx, mutated_xml, _read_river, RIVER),
    "kml": Kind("river.kml", _kml, mutated_xml, _read_river, RIVER),
    "world": Kind("world.npz", _worlds, mutated_npz, World.load, RIVER),
    "suite": Kind("suite.yaml", _suites, mutated_yaml, lambda path: load_suite(str(path)).as_data(), (ResultsError,)),
    "run config": Kind(
        "config.yaml",
        lambda _: [(SAVED / "run" / "config.yaml").read_bytes()],
        mutated_yaml,
        lambda path: sorted(map(str, read_config(path.parent) or {})),  # settings may be infinite
        (TrainingError,),
    ),
    "run status": Kind(
        "status.json",
        lambda _: [(SAVED / "run" / "status.json").read_bytes()],
        mutated_json,
        lambda path: read_status(path.parent),
        (TrainingError,),
    ),
    "checkpoint arrays": Kind(
        "arrays.safetensors",
        _checkpoint("arrays.safetensors"),
        mutated_safetensors,
        _read_checkpoint("arrays.safetensors"),
        (TrainingError,),
    ),
    "checkpoint state": Kind(
        "state.json", _checkpoint("state.json"), mutated_json, _read_checkpoint("state.json"), (TrainingError,)
    ),
    "policy": Kind("policy.safetensors", _policies, mutated_safetensors, _read_policy, (AlgorithmError,)),
    "encoder": Kind(
        "encoder.safetensors", _encoders, mutated_safetensors, _read_encoder, (EncoderFileError, EncoderInputError)
    ),
    "flight": Kind("flight.npz", _flights, mutated_npz, _read_flight, (ViewerError,)),
    "suite record": Kind(
        "suite.json",
        lambda _: [(TINY / "suite.json").read_bytes(), json.dumps(SUITES["paper"].as_data()).encode()],
        mutated_json,
        _read_record,
        (ResultsError,),
    ),
    "versions": Kind(
        "versions.json",
        lambda _: [(REPOSITORY / "benchmarks" / "paper" / "versions.json").read_bytes()],
        mutated_json,
        lambda path: read_versions(path.parent),
        (ResultsError,),
    ),
    "runs": Kind(
        "runs.csv",
        lambda _: [(TINY / "runs.csv").read_bytes(), (REPOSITORY / "benchmarks" / "easy" / "runs.csv").read_bytes()],
        mutated_table,
        lambda path: read_runs(path.parent),
        (ResultsError,),
    ),
    "episodes": Kind(
        "PPO-0-Easy.csv",
        lambda _: [path.read_bytes() for path in sorted((TINY / "evaluation").glob("*.csv"))],
        mutated_table,
        read_episodes,
        (ResultsError,),
    ),
    "training": Kind(
        "episodes.csv",
        lambda _: [(TINY / "runs" / "PPO-0" / "episodes.csv").read_bytes()],
        mutated_table,
        lambda path: read_training(path, TRAINED),
        (ResultsError,),
    ),
    "curve": Kind(
        CURVE,
        lambda _: [(TINY / "runs" / "PPO-0" / CURVE).read_bytes()],
        mutated_table,
        lambda path: read_training(path, TRAINED),
        (ResultsError,),
    ),
}
KINDS |= RUN_KINDS | RESULT_KINDS | RECORDING_KINDS
"""Every kind, by its name in the table."""
