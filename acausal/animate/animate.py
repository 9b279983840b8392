"""`acausal.animate`: 3D animations of models and results."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from acausal.animate.glb import to_glb
from acausal.animate.looks import Look
from acausal.animate.page import to_page
from acausal.animate.scene import Scene, scene_of
from acausal.language.check_model import check_model
from acausal.language.component import Component
from acausal.result.files import atomic, check_suffix
from acausal.result.result import Result
from acausal.simulate.run import simulate

FORMATS = (".html", ".glb", ".gif")


@dataclass(frozen=True, eq=False)
class Animation:
    """A scene with its model and result; `save` writes it."""

    scene: Scene
    model: Component
    result: Result

    def glb(self) -> bytes:
        """Binary glTF 2.0, for Blender, previewers and web pages."""
        return to_glb(self.scene)

    def html(self) -> str:
        """A page with scene, curves and time slider; it needs no network."""
        panels = getattr(type(self.model), "figure", ())
        return to_page(self.scene, self.glb(), self.result, panels)

    def save(self, path: str | Path) -> Path:
        """Write `.html`, `.glb` or `.gif`; UsageError AC012 or AC013."""
        path = check_animation_file(Path(path))
        if path.suffix.lower() == ".gif":
            from acausal.animate.picture import to_gif

            content = to_gif(self.scene)
        else:
            content = self.glb() if path.suffix.lower() == ".glb" else self.html().encode()
        with atomic(path) as file:
            file.write(content)
        return path


def check_animation_file(path: Path) -> Path:
    """The path itself; UsageError AC013 when its suffix is none of `FORMATS`."""
    check_suffix(path, FORMATS, "format of animations")
    return path


def animate(
    model: Component,
    result: Result | None = None,
    *,
    looks: Mapping[type[Component], Look] | None = None,
    poses: int = 2000,
    **options: Any,
) -> Animation:
    """Create the 3D animation of a run.

    Every component of `multibody`, `contact` and `drilling` has a shape. `looks` gives shapes to other components, or
    other shapes to these: functions of a part that yield the shapes to draw, by class.

    Parameters
    ----------
    model
        A component.
    result
        A result of the model; None simulates it, with `options` of `acausal.simulate`, and records `poses` intervals.
    poses
        Maximum number of stored poses of each body.

    Raises
    ------
    UsageError
        AC028 for a `model` that is not a component, AC082 when the result is not of this model, AC083 when nothing in
        the model has a shape.
    """
    check_model(model)
    if result is None:
        experiment = type(model).experiment
        start, stop = (options.get(n) for n in ("start_time", "stop_time"))
        start = experiment.start_time if start is None else start
        stop = experiment.stop_time if stop is None else stop
        options.setdefault("output_interval", (stop - start) / poses)
        result = simulate(model, **options)
    return Animation(scene_of(model, result, looks, poses + 1), model, result)
