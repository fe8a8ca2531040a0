"""The cockpit of one tab: the flight, who flies it, and what becomes of it. Nothing here waits or knows of sockets."""

from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any

from thalweg.core.suggestion import did_you_mean
from thalweg.env import RiverVectorEnv
from thalweg.render import Camera
from thalweg.viewer.errors import ViewerError
from thalweg.viewer.flight.course_map import map_of
from thalweg.viewer.flight.eye import Eye
from thalweg.viewer.flight.flight import Flight, env_of
from thalweg.viewer.flight.flyers import HAND, PILOTS, Flyer, Hand, Pilot, Replay, action_of
from thalweg.viewer.flight.options import FlightOptions
from thalweg.viewer.flight.pictures import PictureKind, pictures, seen_by
from thalweg.viewer.flight.recording import Folder, Recording
from thalweg.viewer.flight.seen_water import SeenWater, refusal
from thalweg.world import World

Policies = Mapping[str, Callable[[], Any]]
"""Functions that load the policies that may fly, by their names on the page."""


class Cockpit:
    """At most one flight at a time."""

    def __init__(self, policies: Policies, folder: Folder, pilot: str = HAND) -> None:
        """`pilot`: who flies first, `hand`, one of `PILOTS`, or one of the policies."""
        self._policies, self.folder = policies, folder
        self.hand = Hand()
        self.pilot = pilot
        """Name of who flies."""
        self.saves_all = False
        """Whether each flight is saved when it ends."""
        self.saved: list[str] = []
        """Names of the flights that were saved here."""
        self.flight: Flight | None = None
        self._flyer: Flyer | None = None
        self._eye: Eye | None = None
        self._water: SeenWater | None = None
        self._plain_eye: Eye | None = None
        self._saved_steps = 0

    def check_pilot(self, name: str) -> None:
        """Raise `ViewerError`, which lists who can fly, for a name that is not among them."""
        known = (HAND, *PILOTS, *self._policies)
        if name not in known:
            raise ViewerError(f"unknown pilot {name!r}{did_you_mean(name, known)}; known: {', '.join(known)}")

    def start(self, world: World, options: FlightOptions) -> dict[str, Any]:
        """Begin a flight; returns what the page is told of it. Raises the errors of `env_of` and `Flight`."""
        self.flight = Flight(self._env(world, options), options)
        self._saved_steps, self._flyer, self._water = 0, None, None
        self.hand.forget_taps()
        self._eye, self._plain_eye = (self._kept(eye) for eye in (self._eye, self._plain_eye))
        if self.pilot == Replay.name:
            self.pilot = HAND
        return {
            "options": {**asdict(options), "world_seed": world.seed},
            "map": map_of(world),
            "cost_kinds": list(self.flight.env.cost_kinds),
            "heights": [options.rules.min_height_m, options.rules.max_height_m],
            "fast": bool(self.flight.env.config.fast_ratio),
            "step_s": self.flight.env.config.step_s,
        }

    def repeat(self, world: World, recording: Recording) -> dict[str, Any]:
        """Begin to repeat a recorded flight; returns as `start`. Raises `ViewerError` for another river."""
        recording.check_river(world)
        told = self.start(world, recording.options)
        assert self.flight is not None
        self.pilot, self._flyer = Replay.name, Replay(recording, self.flight)
        return told

    def control(self, name: str) -> None:
        """Hand the controls over; raises `ViewerError` for an unknown pilot, and the errors of `PolicyFlyer`."""
        self.check_pilot(name)
        before, self.pilot, self._flyer = (self.pilot, self._flyer), name, None
        try:
            if self.flight is not None:
                self._flyer = self._made_flyer()
        except Exception:
            self.pilot, self._flyer = before
            raise
        self.hand.forget_taps()

    def advance(self, steps: int) -> bool:
        """Fly up to so many steps; returns whether the flight can go on.

        Raises `ViewerError` without a flight, and where a recorded flight cannot be repeated; the hand has it then.
        """
        flight = self._flying()
        for _ in range(steps):
            if flight.ended:
                break
            if self._flyer is None:
                self._flyer = self._made_flyer()
            try:
                action = self._flyer.action(flight)
            except ViewerError:
                self._take_over()
                raise
            if action is None:
                self._take_over()
                return False
            self._step(flight, action)
        if flight.ended and self.saves_all:
            self.save()
        return not flight.ended

    def step_by_hand(self, units: tuple[float, ...]) -> None:
        """Take over, and fly one step, see `thalweg.viewer.flight.flyers.action_of`; raises `ViewerError` without a
        flight."""
        flight = self._flying()
        self._take_over()
        if not flight.ended:
            self._step(flight, action_of(flight.env.config, units))
            self.advance(0)

    def save(self) -> str:
        """Save what has been flown, unless that is done; returns the name. Raises the errors of `Folder.save`."""
        flight = self._flying()
        if not self.saved or self._saved_steps != flight.steps or not flight.steps:
            self.saved.append(self.folder.save(flight))
            self._saved_steps = flight.steps
        return self.saved[-1]

    def frame(
        self, picture: PictureKind, share: float, *, mask: bool, seen: bool
    ) -> tuple[dict[str, Any], dict[str, bytes]]:
        """Return the numbers of the flight, and its pictures by kind: the chosen one, the mask if wanted, and if `seen`
        what the policy saw last and the bird's-eye map; `share` as in `Flight.views`.

        The map begins with the first frame that shows it, and is forgotten by one that does not. Raises `ViewerError`
        without a flight.
        """
        flight = self._flying()
        drawn = pictures(flight, dict.fromkeys((picture, "mask") if mask else (picture,)), share)
        camera = flight.views(share).pose[0]
        about = {"camera": [round(float(value), 3) for value in camera], "flies": self.pilot, "saved": self.saved[-1:]}
        if seen:
            drawn = {**drawn, **self._seen(flight, camera)}
            about["unmapped"] = refusal(self._eye_of(flight).camera)
        else:
            self._water = self._plain_eye = None
        return {**flight.status(), **about}, {**drawn}

    def _seen(self, flight: Flight, camera: Any) -> dict[str, bytes]:
        """Return pictures of what the policy saw last, and of the water that was seen around a pose [4]."""
        image, drawn = getattr(self._flyer, "seen", None), {}
        if image is not None:
            drawn["seen"] = seen_by(image, self._flyer.decoded())  # pyright: ignore
        if self._water is None:
            self._water = SeenWater()
            self._look(flight)
        if not refusal(self._eye_of(flight).camera):
            drawn["bird"] = self._water.picture(camera)
        return drawn

    def _take_over(self) -> None:
        """Let the hand fly from now on, by what it holds then."""
        self.hand.forget_taps()
        self.pilot, self._flyer = HAND, self.hand

    def _step(self, flight: Flight, action: Any) -> None:
        """Fly a step, and look at the water after it if its map is shown."""
        flight.step(action, self.pilot)
        self._look(flight)

    def _look(self, flight: Flight) -> None:
        """Enter what is seen now into the bird's-eye map, if there is one and the camera serves it."""
        if self._water is not None and not refusal((eye := self._eye_of(flight)).camera):
            self._water.look(flight, eye)

    def _eye_of(self, flight: Flight) -> Eye:
        """Return the eye of the policy that flies, or one by the usual camera."""
        eye = getattr(self._flyer, "eye", None)
        if eye is not None:
            return eye
        if self._plain_eye is None or not self._plain_eye.serves(flight, Camera()):
            self._plain_eye = Eye(flight, Camera())
        return self._plain_eye

    def _kept(self, eye: Eye | None) -> Eye | None:
        """Return an eye if it serves the current flight; another one would keep its environment and river in memory."""
        return eye if eye is not None and eye.serves(self._flying(), eye.camera) else None

    def _flying(self) -> Flight:
        if self.flight is None:
            raise ViewerError("there is no flight: start one first")
        return self.flight

    def _env(self, world: World, options: FlightOptions) -> RiverVectorEnv:
        """Return the environment of the last flight if it fits, or another one."""
        flight = self.flight
        if flight is not None and flight.world is world and flight.options.rules == options.rules:
            return flight.env
        return env_of(world, options)

    def _made_flyer(self) -> Flyer:
        """Return who flies, with a new memory."""
        flight = self._flying()
        if self.pilot == HAND:
            return self.hand
        if self.pilot in PILOTS:
            pilot = Pilot(self.pilot)
            pilot.action(flight)  # one that the vehicle has not is refused
            return pilot
        from thalweg.viewer.flight.policy_flyer import PolicyFlyer

        flyer = PolicyFlyer(self.pilot, self._policies[self.pilot](), flight, self._eye)
        self._eye = flyer.eye
        return flyer
