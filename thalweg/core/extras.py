"""Optional dependencies: which extra of the package installs a module that is missing."""

EXTRAS = {
    "learn": ("torch", "filelock", "tensorboard", "rich"),
    "cli": ("tyro", "rich", "pandas"),
    "plot": ("matplotlib", "pandas", "jinja2"),
    "film": ("imageio_ffmpeg", "matplotlib"),
    "geo": ("shapely", "pyproj", "gpxpy", "defusedxml"),
    "viewer": ("starlette", "uvicorn", "websockets"),
    "record": ("pyarrow", "minari", "h5py", "pandas", "imageio_ffmpeg"),
    "export": ("onnx", "onnxscript", "onnxruntime"),
    "cuda": ("cuda", "numba_cuda"),
    "cluster": ("ray",),
}
"""Modules that each extra of `pyproject.toml` installs; environments need none of them."""


def how_to_install(extra: str) -> str:
    """Return how to install an extra, in words that hold with and without a package index."""
    return f"install the extra [{extra}], in a clone of Thalweg by: pip install '.[{extra}]'"


def advice_for(error: ModuleNotFoundError) -> str | None:
    """Return how to install the module that an import did not find; None for one that belongs to no extra."""
    missing = (error.name or "").partition(".")[0]
    if not any(missing in modules for modules in EXTRAS.values()):
        return None
    extra = next(extra for extra, modules in EXTRAS.items() if missing in modules)
    several = "all" if extra in ("learn", "cli", "plot", "film", "geo", "viewer", "record", "export") else extra
    return f"{missing} is not installed: {how_to_install(several)}"
