"""A world and poses become frames: colour, water mask, depth and class."""

from thalweg.render.errors import RenderError
from thalweg.render.records.appearance import Look
from thalweg.render.records.camera import Camera
from thalweg.render.records.randomisation import Randomisation
from thalweg.render.renderer import RENDER_VERSION, Frame, Renderer

__all__ = ["RENDER_VERSION", "Camera", "Frame", "Look", "Randomisation", "RenderError", "Renderer"]
