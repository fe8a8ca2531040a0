"""Picture of the architecture page, drawn from the code: `python docs/architecture_picture.py`.

Boxes are the parts of the package with their folders and modules; arrows are imports between parts, as `grimp` reads
them. An import that follows from two others is left out.
"""

from collections import Counter
from pathlib import Path

import grimp
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

PATH = Path(__file__).resolve().parent / "images" / "architecture.png"
BOXES = {
    "cli": (0.0, 0.0, 12.0, 0.9),
    "viewer": (0.0, 1.4, 4.9, 0.9),
    "deploy": (5.2, 1.4, 3.4, 2.4),
    "interop": (9.0, 1.4, 3.0, 2.4),
    "bench": (0.0, 2.7, 4.9, 1.1),
    "train": (0.0, 4.3, 12.0, 0.9),
    "env": (0.0, 5.7, 5.0, 1.45),
    "render": (0.0, 7.65, 5.0, 1.25),
    "world": (0.0, 9.4, 5.0, 1.25),
    "encoder": (5.3, 5.7, 2.1, 4.95),
    "datasets": (7.7, 5.7, 1.8, 4.95),
    "algos": (9.8, 5.7, 2.2, 4.95),
    "core": (0.0, 11.15, 12.0, 0.9),
}
"""Left, top, width and height of each part. Parts import only parts below them, as the contracts in `pyproject.toml`
demand."""
CAPTIONS = {
    "cli": "the thalweg command",
    "viewer": "the page to fly, watch and record",
    "deploy": "policies outside Python",
    "interop": "learners of other libraries",
    "bench": "evaluate, compare, report",
    "train": "where environment, encoder and algorithm meet",
    "env": "the rules, as environments",
    "encoder": "frames to codes",
    "datasets": "recorded flights",
    "algos": "twelve algorithms",
    "render": "a world and poses to frames",
    "world": "a river valley from a seed, a line or a file",
    "core": "files, compilation, devices, versions",
}
COLOURS = {
    "cli": "#e8e3da", "viewer": "#ece0d0", "deploy": "#ead9d9", "interop": "#e3dcc8",
    "bench": "#e9d8c9", "train": "#ead9b6",
    "env": "#d3e2d0", "encoder": "#d9dff0", "datasets": "#d5e4ea", "algos": "#e6d4e6",
    "render": "#cfe3e8", "world": "#d6e6c8", "core": "#e2e2e2",
}  # fmt: skip


def main() -> None:
    graph = grimp.build_graph("thalweg", exclude_type_checking_imports=True)
    figure, axes = plt.subplots(figsize=(12, 12.1))
    for part in BOXES:
        draw_box(axes, part, contents_of(graph, part))
    for importer, imported in arrows(graph):
        draw_arrow(axes, BOXES[importer], BOXES[imported])
    axes.set_xlim(-0.05, 12.05)
    axes.set_ylim(-12.1, 0.05)
    axes.axis("off")
    figure.tight_layout(pad=0.2)
    figure.savefig(PATH, dpi=110)
    print(f"docs/images/{PATH.name}")


def contents_of(graph: grimp.ImportGraph, part: str) -> str:
    """Return the folders of a part, each with its number of modules, and its other modules."""
    prefix = f"thalweg.{part}."
    modules = [name.removeprefix(prefix) for name in graph.modules if name.startswith(prefix)]
    folders = Counter(name.split(".")[0] for name in modules if "." in name)
    alone = sorted({name for name in modules if "." not in name} - set(folders))
    return ", ".join([*(f"{name}/ {count}" for name, count in sorted(folders.items())), *alone])


def arrows(graph: grimp.ImportGraph) -> list[tuple[str, str]]:
    """Return the direct imports between parts, without those that follow from two others."""
    parts = list(BOXES)
    direct = {
        (a, b)
        for a in parts
        for b in parts
        if a != b and graph.find_shortest_chains(f"thalweg.{a}", f"thalweg.{b}", as_packages=True)
    }
    return sorted(pair for pair in direct if not any((pair[0], c) in direct and (c, pair[1]) in direct for c in parts))


def draw_box(axes: Axes, part: str, content: str) -> None:
    left, top, width, height = BOXES[part]
    shape = Rectangle((left, -top - height), width, height, facecolor=COLOURS[part], edgecolor="#555555", linewidth=0.8)
    axes.add_patch(shape)
    axes.text(left + 0.1, -top - 0.1, f"{part}/", fontsize=13, fontweight="bold", va="top")
    beside = width > 3
    axes.text(
        left + (width - 0.1 if beside else 0.1),
        -top - (0.14 if beside else 0.42),
        CAPTIONS[part],
        fontsize=9.5,
        style="italic",
        va="top",
        ha="right" if beside else "left",
    )
    lines = wrapped(content, int(width * 13.2)) if beside else content.split(", ")
    axes.text(left + 0.1, -top - (0.42 if beside else 0.8), "\n".join(lines), fontsize=9.2, va="top", linespacing=1.3)


def draw_arrow(
    axes: Axes, importer: tuple[float, float, float, float], imported: tuple[float, float, float, float]
) -> None:
    """Draw an arrow from the bottom of one box to the top of another, in the middle of the narrower one."""
    narrow = min(importer, imported, key=lambda box: box[2])
    middle = narrow[0] + narrow[2] / 2
    start, end = (middle, -importer[1] - importer[3]), (middle, -imported[1])
    axes.annotate("", end, start, arrowprops={"arrowstyle": "-|>", "color": "#333333", "lw": 1.1})


def wrapped(text: str, width: int) -> list[str]:
    """Return lines of at most `width` characters, broken at commas."""
    lines = [""]
    for word in text.split(", "):
        if lines[-1] and len(lines[-1]) + len(word) + 2 > width:
            lines.append("")
        lines[-1] += ("" if not lines[-1] else ", ") + word
    return lines


if __name__ == "__main__":
    main()
