"""Pictures of scenes in the plane, drawn by compiled loops: discs and lines, with edges smoothed over one pixel.

Places are in pixels, rows and columns from the upper left corner on; the middle of the first pixel is at (0.5, 0.5). Where
things lie on each other, the brighter is seen.
"""

import math

from auroraqd._compiled import compiled


@compiled(nogil=True, error_model="numpy")
def disc(picture, row, column, radius, value):
    """Draw a disc into a picture, (height, width) uint8."""
    line(picture, row, column, row, column, radius, value)


@compiled(nogil=True, error_model="numpy")
def line(picture, row, column, end_row, end_column, radius, value):
    """Draw a line with round ends, `radius` to each side, into a picture, (height, width) uint8."""
    height, width = picture.shape
    margin = radius + 1
    first_row, last_row = max(int(min(row, end_row) - margin), 0), min(int(max(row, end_row) + margin) + 1, height)
    first, last = max(int(min(column, end_column) - margin), 0), min(int(max(column, end_column) + margin) + 1, width)
    down, aside = end_row - row, end_column - column
    squared = down * down + aside * aside
    for i in range(first_row, last_row):
        for j in range(first, last):
            y, x = i + 0.5 - row, j + 0.5 - column
            share = min(max((y * down + x * aside) / squared, 0.0), 1.0) if squared > 0 else 0.0
            covered = min(max(radius + 0.5 - math.hypot(y - share * down, x - share * aside), 0.0), 1.0)
            picture[i, j] = max(picture[i, j], int(covered * value + 0.5))
