"""Images of one camera in a folder: their order, and how they are turned."""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import cv2
import numpy as np

from ...core.errors import CaptureError
from ..tags.detection import Image

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm")


def list_images(folder: Path) -> list[Path]:
    """Return the images of a folder in the order of the numbers in their names.

    Raises:
        CaptureError: If it has none (`images-missing`).
    """
    images = [p for p in folder.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES]
    if not images:
        raise CaptureError(
            f"the folder has no images ({', '.join(IMAGE_SUFFIXES)})",
            code="images-missing",
            where=folder,
            action="Choose another folder",
        )
    return sorted(images, key=_natural_key)


def list_numbered_images(pattern: Path) -> dict[int, Path]:
    """Return images by number, in order, of a pattern such as `a%04d.png`.

    Raises:
        CaptureError: If there are none (`images-missing`), or two have the same number
            (`images-repeated`).
    """
    parts = re.split(r"%0?(\d*)d", pattern.name)
    images: dict[int, Path] = {}
    if len(parts) == 3 and pattern.parent.is_dir():
        start, digits, end = parts
        number = rf"(\d{{{digits or 1},}})"
        name = re.compile(re.escape(start) + number + re.escape(end))
        matches = ((name.fullmatch(p.name), p) for p in pattern.parent.iterdir())
        for number_found, path in sorted((int(m[1]), p) for m, p in matches if m):
            if number_found in images:
                raise CaptureError(
                    f"{images[number_found].name} and {path.name} have the same number",
                    code="images-repeated",
                    where=pattern,
                    action="Remove or rename one of them",
                    number=number_found,
                )
            images[number_found] = path
    if not images:
        raise CaptureError(
            "no images have names of this pattern",
            code="images-missing",
            where=pattern,
            action="Give a pattern such as a%04d.png for a0001.png, a0002.png, ..., or the folder",
        )
    return dict(sorted(images.items()))


def _natural_key(path: Path) -> tuple[list[str | int], str]:
    """Return a key that sorts a9 before a10."""
    parts = re.split(r"(\d+)", path.name)
    return [int(p) if k % 2 else p for k, p in enumerate(parts)], path.name


#: By the orientation in an image's metadata (Exif): whether rows and columns are exchanged, and
#: whether the rows and the columns are reversed after that.
_TURNS = {
    2: (False, False, True),
    3: (False, True, True),
    4: (False, True, False),
    5: (True, False, False),
    6: (True, False, True),
    7: (True, True, True),
    8: (True, True, False),
}
_ORIENTED_SUFFIXES = (".png", ".jpg", ".jpeg")  # whose orientation OpenCV reads


def read_orientation(path: Path) -> int:
    """Return the orientation in an image's metadata, 1 to 8 as Exif defines; 1 if it has none."""
    if path.suffix.lower() not in _ORIENTED_SUFFIXES:
        return 1
    from PIL import ExifTags
    from PIL import Image as PillowImage

    try:
        with warnings.catch_warnings(action="ignore"), PillowImage.open(path) as image:
            orientation = image.getexif().get(ExifTags.Base.Orientation, 1)
    except (OSError, SyntaxError, ValueError, PillowImage.DecompressionBombError):
        return 1  # OpenCV decides whether the image can be read
    return orientation if orientation in _TURNS else 1


def read_image(path: Path, orientation: int) -> Image:
    """Read an image of a camera.

    A hand-held camera states in each image how it was held. The pixels of all images are those of
    one sensor, so images that were turned differently would not have one lens: turn them all as the
    first one.

    Args:
        path: File of the image.
        orientation: Orientation (Exif, 1 to 8) by which the image is turned, whatever it states.

    Returns:
        The image (h, w, 3).

    Raises:
        CaptureError: If the file is not an image (`image-unreadable`).
    """
    image = cv2.imread(str(path), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    if image is None:
        raise CaptureError(
            "cannot be read as an image",
            code="image-unreadable",
            where=path,
            action="Check that it is an image and is not damaged",
            file=path.name,
        )
    return _turn_image(np.asarray(image, np.uint8), orientation)


def _turn_image(image: Image, orientation: int) -> Image:
    """Return an image (h, w, 3) turned upright by its orientation (Exif, 1 to 8)."""
    if orientation not in _TURNS:
        return image
    is_transposed, reverse_rows, reverse_columns = _TURNS[orientation]
    turned = image.swapaxes(0, 1) if is_transposed else image
    steps = -1 if reverse_rows else 1, -1 if reverse_columns else 1
    return np.ascontiguousarray(turned[:: steps[0], :: steps[1]])
