"""Write what was measured here into the pages, between comments that name the section, so that no figure is typed.

`peer.json` goes into the README, `speed.json` and `speed_avx2.json` into the page on speed, `stages.json`,
`lenses.csv`, `reference_accuracy.csv` and `scaling.csv` into the page on rendering, `fly_rate.csv` into the page on
flying by hand, `gpu.csv` into the page on devices, probes of the packaged encoders into the page on encoders, and the
results of the study into the page of findings. What has not been measured is marked as such.
"""

import argparse
import json
import statistics
import sys
from collections.abc import Callable
from pathlib import Path

import findings
import fly_rate
import further_findings
from page_sections import beside, replace_section, wrap

from thalweg.bench.csv_files import read_csv
from thalweg.bench.report.table import frame, markdown
from thalweg.bench.speed.frame_profile import REFLECTION
from thalweg.bench.speed.speed_table import describe, speed_frame
from thalweg.core.atomic_io import write_atomic

ROOT = Path(__file__).resolve().parent.parent
HERE = ROOT / "benchmarks"
FOUND = ROOT / "docs" / "findings.md"
NOT_YET = "Not measured yet.\n"


def comparison() -> str:
    """Return Thalweg beside the simulators that researchers of this field use; speeds of two of them are measured."""
    found = json.loads((HERE / "peer.json").read_text(encoding="utf-8"))
    fastest = {
        side: max(
            statistics.median(each["rates"])
            for each in found["measurements"]
            if each["side"] == side and each["kind"] != "frame"
        )
        for side in ("Thalweg", "Safety-Gymnasium")
    }
    header = ["", "Thalweg", "Safe Riverine Environment", "Safety-Gymnasium, vision", "AirSim and the like"]
    rows = [
        [
            "scenes",
            "natural rivers, one for each seed; real ones from OpenStreetMap, GeoJSON, GPX or KML",
            "three rivers",
            "simple shapes",
            "any",
        ],
        ["source", "open, Python", "closed Unity build", "open, MuJoCo", "open, Unreal Engine"],
        ["needs", "pip", "the build", "OpenGL", "Unreal Engine and a GPU"],
        ["water mask, depth, classes", "yes", "mask", "depth", "yes"],
        ["costs and safe RL algorithms", "costs, twelve algorithms", "costs", "costs; algorithms by OmniSafe", "no"],
        ["same seed, same frames", "to the bit", "not documented", "yes", "not documented"],
        [
            "steps a second with a 128 x 128 frame",
            f"**{fastest['Thalweg']:,.0f}**",
            "about 40",
            f"{fastest['Safety-Gymnasium']:,.0f}",
            "not measured",
        ],
    ]
    note = wrap(
        "We measured Thalweg and Safety-Gymnasium in one run on two processor cores without a GPU;"
        " [the benchmarks](benchmarks/README.md) have the details. The speed of the Safe Riverine Environment is"
        " that of its published training logs, which have 32 to 48 training steps a second."
    )
    return f"{markdown(frame(header, rows))}\n{note}"


def speed() -> str:
    """Return the table of speeds, with the machine."""
    found = json.loads((HERE / "speed.json").read_text(encoding="utf-8"))
    machine = wrap(f"Median, slowest and fastest repetition on {describe(found)}.")
    return f"{markdown(speed_frame(found))}\n{machine}"


def other_processor() -> str:
    """Return the medians on another kind of processor beside those of the table of speeds."""
    main, other = (json.loads((HERE / name).read_text(encoding="utf-8")) for name in ("speed.json", "speed_avx2.json"))
    merged = speed_frame(main).merge(speed_frame(other), on=["what", "frame"])
    rows = merged[["what", "frame", "median_x", "median_y", "unit_x"]].to_numpy().tolist()
    kinds = [f"{found['machine']['cpu_type']}, {found['machine']['vector_bits']} bits" for found in (main, other)]
    table = markdown(frame(["what", "frame", *kinds, "unit"], rows))
    return f"{table}\n{wrap(f'Medians; the second machine is {describe(other)}.')}"


def frame_stages() -> str:
    """Return the table of a frame's stages: mean, least and greatest over the views."""
    found = json.loads((HERE / "stages.json").read_text(encoding="utf-8"))
    lines = found["measurements"]
    rows = [[line["name"], *(f"{line[key]:.2f}" for key in ("median", "fastest", "slowest"))] for line in lines]
    total = sum(line["median"] for line in lines if line["name"] != REFLECTION)
    header = ["stage", "ms a frame", "of the quickest view", "of the slowest"]
    summary = wrap(
        f"{total:.2f} ms in all, the reflection being a part of the water's;"
        f" {lines[0]['features'].split('; ')[1]}, {lines[0]['resolution']}; {describe(found)}."
    )
    return f"{markdown(frame(header, rows))}\n{summary}"


def reference_accuracy() -> str:
    """Return how close the kernel's frames are to the reference renderer's."""
    rows = read_csv(HERE / "reference_accuracy.csv", ("psnr_db", "mask", "class"))
    decibels, masks, kinds = ([float(row[name]) for row in rows] for name in ("psnr_db", "mask", "class"))
    return wrap(
        f"Over {len(rows)} poses at {rows[0]['pixels']} x {rows[0]['pixels']}, one sample a pixel against"
        f" {rows[0]['samples']}: {statistics.mean(decibels):.1f} dB (least {min(decibels):.1f}). The mask agrees at"
        f" {statistics.mean(masks):.2%} of the pixels (least {min(masks):.2%}), the class at"
        f" {statistics.mean(kinds):.1%}."
    )


def scaling() -> str:
    """Return frames per second by cameras and size, and by worlds."""
    columns = ("cameras", "pixels", "worlds", "frames_per_s", "cpu_type", "vector_bits")
    rows = read_csv(HERE / "scaling.csv", columns)
    rate = {
        tuple(int(row[name]) for name in ("cameras", "pixels", "worlds")): float(row["frames_per_s"]) for row in rows
    }
    cameras = sorted({c for c, _, w in rate if w == 4})
    sizes = sorted({p for _, p, _ in rate})
    rows_by_size = [[f"{size} x {size}", *(f"{rate[c, size, 4]:,.0f}" for c in cameras)] for size in sizes]
    alone = {w: each for (c, p, w), each in rate.items() if p == 128 and c == max(16, w)}
    worlds = [f"{w}: {alone[w]:,.0f}" for w in sorted(alone)]
    header = ["frames a second, four worlds", *(f"{c} cameras" if c > 1 else "one camera" for c in cameras)]
    by_worlds = wrap(
        f"Frames a second at 128 x 128 by distinct worlds: {'; '.join(worlds)}. Both on two cores of type"
        f" {rows[0]['cpu_type']}, with vectors of {rows[0]['vector_bits']} bits."
    )
    return f"{markdown(frame(header, rows_by_size))}\n{by_worlds}"


def lenses() -> str:
    """Return the time of a frame behind each lens."""
    columns = ("lens", "wide_height_px", "wide_width_px", "least_ms", "median_ms", "cpu_type", "vector_bits", "load")
    rows = read_csv(HERE / "lenses.csv", columns)
    header = ["lens", "pinhole that is drawn", "ms a frame", "least", "times the first"]
    lines = [
        [
            row["lens"],
            f"{row['wide_height_px']} x {row['wide_width_px']}",
            row["median_ms"],
            row["least_ms"],
            f"{float(row['median_ms']) / float(rows[0]['median_ms']):.1f}",
        ]
        for row in rows
    ]
    machine = wrap(
        "128 x 128 pixels, full quality, one thread, 16 random views of Medium, median and least of 15 turns, in which"
        f" the cameras took turns, {beside(rows[0]['load'])}. A processor of type"
        f" {rows[0]['cpu_type']}, with vectors of {rows[0]['vector_bits']} bits."
    )
    return f"{markdown(frame(header, lines))}\n{machine}"


def gpu_speed() -> str:
    """Return speeds on a GPU by the number of environments, and how they agree with the CPU."""
    rows = read_csv(HERE / "gpu.csv", ("card", "what", "quality", "cameras", "worlds", "figure", "holds"))
    speeds = [row for row in rows if not row["holds"]]
    counts = sorted({int(row["cameras"]) for row in speeds})
    lines = []
    for what, quality, worlds in dict.fromkeys((row["what"], row["quality"], row["worlds"]) for row in speeds):
        of = {
            int(row["cameras"]): float(row["figure"])
            for row in speeds
            if (row["what"], row["quality"], row["worlds"]) == (what, quality, worlds)
        }
        lines.append(
            [f"{what} {quality}".strip(), worlds, *(f"{of[count]:,.0f}" if count in of else "" for count in counts)]
        )
    lines.sort(key=lambda line: (int(line[1]), line[0]))
    apart = {(row["what"], row["quality"]): row for row in rows if row["holds"]}
    pixels = {quality: 1.0 - float(apart["pixels alike", quality]["figure"]) for quality in ("full", "fast")}
    checked, compared = apart["pixels alike", "full"], apart["steps alike", ""]
    timed = any(row["what"].startswith("fly ") for row in speeds)
    flown = " `fly` those of a task with its frames of full quality," if timed else ""
    note = wrap(
        f"Steps or frames a second of as many environments or cameras together as the column says, on an"
        f" {rows[0]['card']} with 16 processor cores."
        f" `encode` is the encoder alone, `step` the rules alone,{flown} and `train` draws frames of full quality,"
        f" encodes them, acts and learns. Of"
        f" {checked['cameras']} frames in {checked['worlds']} rivers"
        f" {pixels['full']:.4%} of the pixels of full quality and {pixels['fast']:.4%} of the fast one differ from the"
        f" CPU's by more than 2 of 255; {1.0 - float(apart['steps alike', '']['figure']):.4%} of the steps of"
        f" {int(compared['cameras']):,} environments have another reward, cost or reason, and poses are within"
        f" {float(apart['poses apart', '']['figure']):.0e} m."
    )
    header = ["", "rivers", *(f"{count:,}" for count in counts)]
    return f"{markdown(frame(header, lines))}\n{note}"


SECTIONS: dict[tuple[Path, str], tuple[str, Callable[[], str]]] = {
    (ROOT / "README.md", "comparison"): ("peer.json", comparison),
    (ROOT / "docs" / "speed.md", "speed"): ("speed.json", speed),
    (ROOT / "docs" / "speed.md", "speed-avx2"): ("speed_avx2.json", other_processor),
    (ROOT / "docs" / "devices.md", "gpu"): ("gpu.csv", gpu_speed),
    (ROOT / "docs" / "render.md", "stages"): ("stages.json", frame_stages),
    (ROOT / "docs" / "render.md", "reference"): ("reference_accuracy.csv", reference_accuracy),
    (ROOT / "docs" / "render.md", "lenses"): ("lenses.csv", lenses),
    (ROOT / "docs" / "render.md", "scaling"): ("scaling.csv", scaling),
    (ROOT / "docs" / "fly.md", "rate"): ("fly_rate.csv", fly_rate.table),
    (ROOT / "docs" / "encoder.md", "geometry"): ("encoders/geometry.csv", findings.geometry),
    (ROOT / "docs" / "encoder.md", "geometry tasks"): ("encoders/geometry_tasks.csv", findings.geometry_of_tasks),
    (FOUND, "results"): ("paper/runs.csv", findings.results_of_the_page),
    (FOUND, "study"): ("paper/runs.csv", findings.returns_and_costs),
    (FOUND, "keeping"): ("paper/runs.csv", findings.limits),
    (FOUND, "pairs"): ("paper/runs.csv", findings.pairs_without_limit),
    (FOUND, "training"): ("paper/runs.csv", findings.training_costs),
    (FOUND, "elsewhere"): ("paper/runs.csv", findings.conditions),
    (FOUND, "sizes"): ("encoders/sizes.csv", findings.sizes),
    (FOUND, "probes"): ("encoders/sizes.csv", findings.probes),
    (FOUND, "entropies"): ("encoders/entropy.csv", findings.entropies),
    (FOUND, "open"): ("open/runs.csv", findings.open_choices),
    (FOUND, "ways"): ("open/runs.csv", findings.pairs_of_open_choices),
    (FOUND, "protocols"): ("protocols/runs.csv", further_findings.ways_of_training),
    (FOUND, "codes"): ("geometry/runs.csv", further_findings.codes_of_geometry),
}


def main() -> int:
    """Write the sections."""
    parser = argparse.ArgumentParser(description="Write what was measured into the pages.")
    parser.add_argument("--check", action="store_true", help="write nothing; fail where a page is not up to date")
    check = parser.parse_args().check
    stale = []
    for (page, name), (source, compute) in SECTIONS.items():
        old = page.read_text(encoding="utf-8")
        new = replace_section(old, name, compute() if (HERE / source).exists() else NOT_YET)
        if new != old:
            stale.append(f"{name} in {page.name}")
            if not check:
                write_atomic(page, new)
    if stale and check:
        print(f"stale, `python benchmarks/write_figures.py` writes them: {', '.join(stale)}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
