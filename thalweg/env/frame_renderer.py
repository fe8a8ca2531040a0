"""Rendering for a vector environment: cameras, appearances and lights of N environments, drawn by one renderer."""

from collections.abc import Collection, Sequence
from dataclasses import fields, replace
from inspect import signature
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from thalweg.env.config import DEFAULT_CONFIG, ConfigError, EnvConfig
from thalweg.env.task.course_arrays import fingerprint
from thalweg.env.task.rules import State
from thalweg.render.bake.sunlight import relit
from thalweg.render.records.appearance import PARAMETERS, look_rows, look_values
from thalweg.render.records.camera import Distortion
from thalweg.render.records.pinhole import CameraMatrices
from thalweg.render.records.quality import Quality
from thalweg.render.records.randomisation import Randomisation
from thalweg.render.slot_renderer import SlotRenderer
from thalweg.world.record import World

if TYPE_CHECKING:
    from thalweg.render.renderer import Frame, Layer


class Views(NamedTuple):
    """What M cameras see. Where nothing is observed, only `pose` is there, and all else is None."""

    pose: np.ndarray
    """[M, 4] float64."""
    world: np.ndarray
    """[M] int64."""
    time_s: np.ndarray
    """[M] float64."""
    look: np.ndarray
    """[M, P] float64, see `thalweg.render.records.appearance`."""
    sun: np.ndarray
    """[M] int64, index of the light among those of the world."""
    segment: np.ndarray
    """[M] int64, of the course, and the direction of travel along it; see `thalweg.env.task.rules.State`."""
    travel: np.ndarray
    steps: np.ndarray
    """[M] int64, and what the task keeps; see `State`."""
    scene: np.ndarray
    station: np.ndarray
    wind: np.ndarray | None = None
    """[M, 2] float64, m/s towards east and north: the mean wind of the episode; None is no wind."""
    proprioception: np.ndarray | None = None
    """[M, P] float32, see `thalweg.env.task.proprioception`; None where it is not observed."""
    props: np.ndarray | None = None
    """[M, P, 6] float32, objects to be drawn in place of those of the task; None: those of the task."""

    def rows(self, rows: np.ndarray) -> "Views":
        """Return some of the views, by mask [M] bool or indices."""
        some: list[Any] = [None if array is None else array[rows] for array in self]
        return Views(*some)

    def and_views(self, others: "Views") -> "Views":
        """Return these views followed by those of others."""
        pairs = zip(self, others, strict=True)
        both: list[Any] = [None if a is None or b is None else np.concatenate([a, b]) for a, b in pairs]
        return Views(*both)


def relit_worlds(worlds: Sequence[World], randomisation: Randomisation | None) -> list[World]:
    """Return the worlds, each under every light of the randomisation, grouped by world."""
    if randomisation is None or not randomisation.suns:
        return list(worlds)
    return [relit(world, *light) for world in worlds for light in randomisation.lights(world.seed)]


def lights_per_world(randomisation: Randomisation | None) -> int:
    """Return the number of lights in which each world is rendered."""
    return max(randomisation.suns, 1) if randomisation is not None else 1


class FrameRenderer:
    """Renders the cameras of N environments, each with an appearance and a light of its own."""

    def __init__(
        self,
        worlds: Sequence[World],
        num_envs: int,
        config: EnvConfig,
        renderer: Any = None,
        *,
        changing: bool = False,
        device: str = "cpu",
    ) -> None:
        """`changing`: worlds are put into the slots of `slots` one at a time instead of being given here. `device`:
        where frames are drawn, unless a `renderer` is given.

        Raises `ConfigError` for a `renderer` that does not fit the worlds or the config, and `RenderError` for a
        randomisation that leads to impossible cameras.
        """
        self.slots: SlotRenderer | None = None
        """Where worlds are put that change; None if they do not."""
        self.worlds, self.randomisation = worlds, config.randomisation
        if changing:
            self.slots = renderer = _slot_renderer(config, renderer, device)
            if config.randomisation is not None:
                # Each world has one sun, which is chosen when it is put into a slot.
                self.randomisation = replace(config.randomisation, suns=0)
        if renderer is not None and not changing:
            if config.randomisation is not None:
                raise ConfigError("randomisation needs a renderer of its own: give either that or a renderer")
            _check_renderer(renderer, worlds, config)
            if config.draws_layers and not hasattr(renderer, "render_layers"):
                raise ConfigError(
                    f"the observation {','.join(config.parts)} needs a renderer with `render_layers`, which"
                    f" {type(renderer).__name__} has not"
                )
        self.camera = config.camera if renderer is None else renderer.camera
        if config.randomisation is not None:
            look_rows(config.randomisation.ends, self.camera)  # refuses angles outside the range of a camera
        self._renderer, self._device = renderer, device
        self._quality: Quality = config.quality
        self.lights = lights_per_world(self.randomisation)
        """Lights of each world."""
        self.look = look_values(None, num_envs)
        """[N, P] appearance of each environment."""
        self.sun = np.zeros(num_envs, dtype=np.int64)
        """[N] index of the light of each environment."""
        self.wind = np.zeros((num_envs, 2))
        """[N, 2] mean wind of each environment, m/s towards east and north."""
        self._windy = config.wind is not None

    def draw_look(self, row: int, period: str, generator: np.random.Generator) -> None:
        """Draw the look of one environment if it changes with this period, "episode" or "environment"."""
        if self.randomisation is not None and self.randomisation.per == period:
            self.look[row], self.sun[row] = self.randomisation.draw(generator)

    def views(self, state: State, rows: np.ndarray | slice = slice(None)) -> Views:
        """Return copies of what the environments `rows` see in a state."""
        seen = state.pose, state.world, state.time_s, self.look, self.sun, state.segment, state.travel
        values = *seen, state.steps, state.scene, state.station, self.wind
        return Views(*(a[rows].copy() for a in values))

    def camera_matrices(self, poses: np.ndarray) -> CameraMatrices:
        """Return the matrices of the N cameras at poses [N, 4], each with the lens of its look."""
        look = dict(zip(PARAMETERS, self.look.T, strict=True))
        return self.camera.camera_matrices(poses, look["pitch_deg"], look["fov_deg"])

    @property
    def distortion(self) -> Distortion:
        """Distortion of the N cameras, each with the lens of its look."""
        return self.camera.distortion(self.look[:, PARAMETERS.index("fov_deg")])

    def render_masks(self, views: Views, props: np.ndarray | None = None) -> np.ndarray:
        """Return new masks [M, H, W, 1] uint8 of the views, the fourth channel of their frames; props: as in
        `render`."""
        # A renderer of someone else's may draw nothing but whole frames.
        if not hasattr(self._drawer(), "render_mask"):
            return self.render(views, props)[..., 3:].copy()
        return self._drawer().render_mask(views.pose, self._lit_world(views), **self._options(views, props))[..., None]

    def render(self, views: Views, props: np.ndarray | None = None) -> np.ndarray:
        """Return new frames [M, H, W, 4] uint8 of the views; props [M, P, 6]: the objects of a task in each."""
        out = np.empty((len(views.pose), self.camera.height_px, self.camera.width_px, 4), dtype=np.uint8)
        world = self._lit_world(views)
        return self._drawer().render(views.pose, world, views.time_s, out, **self._options(views, props, windy=True))

    def _lit_world(self, views: Views) -> np.ndarray:
        """Return the index [M] of the world of each view in its light."""
        return views.world if self.randomisation is None else views.world * self.lights + views.sun

    def _options(self, views: Views, props: np.ndarray | None, *, windy: bool = False) -> dict[str, Any]:
        """Return what is given to the renderer by name: only what there is, as another renderer may know less; `windy`:
        the wind too, if the renderer shows any."""
        looks: dict[str, Any] = {} if self.randomisation is None else {"look": views.look}
        if windy and self._windy and "wind" in signature(self._drawer().render).parameters:
            looks["wind"] = views.wind
        return looks if props is None else {**looks, "props": props}

    def render_layers(self, views: Views, layers: "Collection[Layer]", props: np.ndarray | None = None) -> "Frame":
        """Return new `Frame`s of the views with these layers; nothing is drawn that they do not need; props: as in
        `render`."""
        world, options = self._lit_world(views), self._options(views, props, windy=True)
        return self._drawer().render_layers(views.pose, world, views.time_s, layers=layers, **options)

    def _drawer(self) -> Any:
        """Return the renderer, which is created when it is first needed."""
        if self._renderer is None:
            from thalweg.render import Renderer

            worlds = relit_worlds(self.worlds, self.randomisation)
            self._renderer = Renderer(worlds, self.camera, self._quality, self._device)
        return self._renderer


def _slot_renderer(config: EnvConfig, renderer: Any, device: str) -> SlotRenderer:
    """Return a renderer of worlds that change; raises `ConfigError` for a given one."""
    if renderer is not None:
        raise ConfigError("rivers that change need a renderer of their own: leave `renderer` out")
    return SlotRenderer(config.camera, config.quality, config.randomisation, device)


def _check_renderer(renderer: Any, worlds: Sequence[World], config: EnvConfig) -> None:
    """Raise `ConfigError` for a renderer of other worlds, or of another camera or quality than the config sets."""
    rendered = getattr(renderer, "worlds", None)
    if rendered is not None and not (
        len(rendered) == len(worlds)
        and all(a is b or fingerprint(a) == fingerprint(b) for a, b in zip(rendered, worlds, strict=True))
    ):
        raise ConfigError("the renderer draws other worlds than those of this environment")
    wanted = {each.name: getattr(config.camera, each.name) for each in fields(config.camera)}
    different = [name for name, value in wanted.items() if getattr(renderer.camera, name, value) != value]
    if different and config.camera != DEFAULT_CONFIG.camera:
        raise ConfigError(f"config.camera is not the renderer's: {', '.join(different)} of {config.camera}")
    quality = getattr(renderer, "quality", config.quality)
    if config.quality not in (quality, DEFAULT_CONFIG.quality):
        raise ConfigError(f"config.quality = {config.quality!r} is not the renderer's, {quality!r}")
