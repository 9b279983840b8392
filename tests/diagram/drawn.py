"""What an SVG of a diagram says in numbers: rectangles of closed blocks, lines of connections."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from itertools import pairwise

Point = tuple[float, float]
_SVG = "{http://www.w3.org/2000/svg}"


@dataclass(frozen=True)
class Drawn:
    """Rectangles (x, y, width, height) by path, of closed blocks and of open ones; lines by their ends."""

    blocks: dict[str, tuple[float, float, float, float]]
    compounds: dict[str, tuple[float, float, float, float]]
    lines: dict[str, list[list[Point]]]
    classes: dict[str, str]
    texts: tuple[str, ...]


def drawn(svg: str) -> Drawn:
    """Read a picture of `diagram.js`."""
    root = ET.fromstring(svg)
    blocks: dict[str, tuple[float, float, float, float]] = {}
    compounds: dict[str, tuple[float, float, float, float]] = {}
    lines: dict[str, list[list[Point]]] = {}
    classes: dict[str, str] = {}
    for group in root.iter(f"{_SVG}g"):
        path, edge = group.get("data-path"), group.get("data-edge")
        if path is not None:
            rect = next((r for r in group.findall(f"{_SVG}rect")), None)
            symbol = next((g for g in group.findall(f"{_SVG}g")), None)
            if rect is not None:
                x, y, width, height = (float(rect.get(k, "nan")) for k in ("x", "y", "width", "height"))
                (compounds if rect.get("class") == "compound" else blocks)[path] = x, y, width, height
            elif symbol is not None:
                x, y = map(float, re.findall(r"[-\d.]+", symbol.get("transform", "")))
                blocks[path] = x, y, 60.0, 40.0
        elif edge is not None:
            classes[edge] = group.get("class", "")
            paths = [p.get("d", "") for p in group.findall(f"{_SVG}path") if p.get("class") == "edge"]
            numbers = [[float(n) for n in re.findall(r"[-\d.]+", d)] for d in paths]
            lines[edge] = [list(zip(n[::2], n[1::2], strict=True)) for n in numbers]
    texts = tuple("".join(t.itertext()) for t in root.iter(f"{_SVG}text"))
    return Drawn(blocks, compounds, lines, classes, texts)


def slanted(picture: Drawn) -> list[str]:
    """Lines that are neither horizontal nor vertical somewhere."""
    return [
        edge
        for edge, sections in picture.lines.items()
        for points in sections
        for (x, y), (u, v) in pairwise(points)
        if abs(x - u) > 1e-6 and abs(y - v) > 1e-6
    ]


def crossing(picture: Drawn) -> list[tuple[str, str]]:
    """Lines that run through a closed block, 2 pixels inside of its border."""
    found = []
    for edge, sections in picture.lines.items():
        for points in sections:
            for (x, y), (u, v) in pairwise(points):
                for path, (left, top, width, height) in picture.blocks.items():
                    inside_x = max(min(x, u), left + 2) < min(max(x, u), left + width - 2) or (
                        x == u and left + 2 < x < left + width - 2
                    )
                    inside_y = max(min(y, v), top + 2) < min(max(y, v), top + height - 2) or (
                        y == v and top + 2 < y < top + height - 2
                    )
                    if inside_x and inside_y:
                        found.append((edge, path))
    return found


def text_boxes(svg: str) -> list[tuple[float, float, float, float]]:
    """Left, top, right and bottom of the names below, above and beside symbols, estimated from their letters."""
    found = []
    for text in ET.fromstring(svg).iter(f"{_SVG}text"):
        size = {"name": 11.0, "cls": 9.0}.get(text.get("class", ""))
        if size is not None:
            x, y, width = float(text.get("x", "nan")), float(text.get("y", "nan")), 0.6 * size * len(text.text or "")
            left = x if "start" in text.get("style", "") else x - width / 2
            found.append((left, y - 0.75 * size, left + width, y))
    return found


def squares(svg: str) -> list[tuple[float, float, float, float]]:
    """Left, top, right and bottom of the squares of connectors."""
    rects = (r for r in ET.fromstring(svg).iter(f"{_SVG}rect") if r.get("width") == "6" and r.get("height") == "6")
    corners = ((float(r.get("x", "nan")), float(r.get("y", "nan"))) for r in rects)
    return [(x, y, x + 6.0, y + 6.0) for x, y in corners]
