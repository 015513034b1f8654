"""Small pictures for pages of text."""

from __future__ import annotations

import io

import numpy as np
from PIL import Image

COLOURS = 128
"""Of a small picture: those that fill most of it, as they are; all others go to the nearest."""


def small_png(picture: bytes) -> bytes:
    """Return a PNG picture with few colours: lines on paper take less than half of the bytes."""
    pixels = np.asarray(Image.open(io.BytesIO(picture)).convert("RGB")).astype(np.int32)
    height, width, _ = pixels.shape
    found, place, counts = np.unique(
        pixels.reshape(-1, 3), axis=0, return_inverse=True, return_counts=True
    )
    common = found[np.argsort(-counts, kind="stable")[:COLOURS]]
    distance = np.sum((found[:, None, :] - common[None, :, :]) ** 2, axis=2)
    nearest = np.argmin(distance, axis=1).astype(np.uint8)
    few = Image.frombytes("P", (width, height), nearest[place.ravel()].tobytes())
    few.putpalette(common.astype(np.uint8).tobytes())
    return _written(few)


def screen_png(picture: bytes) -> bytes:
    """Return a PNG picture of a screen with 256 colours, rare ones of thin lines among them."""
    whole = Image.open(io.BytesIO(picture)).convert("RGB")
    few = whole.quantize(256, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    return _written(few)


def _written(picture: Image.Image) -> bytes:
    stream = io.BytesIO()
    picture.save(stream, "PNG", optimize=True)
    return stream.getvalue()
