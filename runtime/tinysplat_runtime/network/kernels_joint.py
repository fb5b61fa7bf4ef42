"""Kernels of the joint depth step: what a plane costs at a pixel, and a search over planes. See `joint.py`.

A photo is worked on beside copies of its sources, in one array whose first row is the photo's own. Pixels have their
centres at (x + ½, y + ½). A plane is its inverse depth at the pixel and how much that grows from a pixel to the next,
(w, ∂w/∂x, ∂w/∂y).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..system.kernels_compile import Number, compiled, within


class Search(NamedTuple):
    """How planes are tried, and what their cost is made of; pixels are those of the searched maps.

    Attributes:
        radius: of the compared window, of which every other pixel counts.
        reach_colour, reach_place: difference of colour, and pixels, at which a pixel of the window weighs 1/e (adaptive
            support, Yoon & Kweon 2006).
        noise: variance of grey in [0, 1] below which there is no texture.
        share: of the sources that count, the best ones; others may be occluded (COLMAP, ACMH).
        colour, colour_most: weight of the difference of colours, and the difference from which it grows no more.
        agree, agree_px: weight of the pixels between a plane's depth and that of a source's map, and how many are as
            bad as any.
        pull, pull_px, least_pull: weight of leaving the network's depth where there is no texture, pixels that are as
            bad as any, and its share elsewhere.
        smooth, smooth_px, smooth_colour: weight of jumps to neighbours, jumps that are as bad as any, and difference of
            colour at which they are free.
        unseen: cost of a plane that no source sees.
        steps: a pixel's own plane is tried so many times, one and two pixels of parallax nearer and farther.
        same_px: planes that differ from the best so far by less parallax are not tried.
    """

    radius: int = 2
    reach_colour: float = 0.12
    reach_place: float = 4.0
    noise: float = 5e-5
    share: float = 0.5
    colour: float = 0.5
    colour_most: float = 0.1
    agree: float = 0.3
    agree_px: float = 3.0
    pull: float = 0.1
    pull_px: float = 4.0
    least_pull: float = 0.15
    smooth: float = 0.05
    smooth_px: float = 2.0
    smooth_colour: float = 0.04
    unseen: float = 0.6
    steps: int = 4
    same_px: float = 0.15


SEARCH = Search()

_F, _I = np.float32, np.int64
_SPAN = range(-SEARCH.radius, SEARCH.radius + 1)
_ZERO, _HALF, _ONE, _FAR = _F(0), _F(0.5), _F(1), _F(1e9)
_ACROSS = np.array([x for y in _SPAN for x in _SPAN if not (x + y) % 2], _F)
_DOWN = np.array([y for y in _SPAN for x in _SPAN if not (x + y) % 2], _F)
_TAPS = len(_ACROSS)
_NEAR_X, _NEAR_Y = np.array([1, -1, 0, 0]), np.array([0, 0, 1, -1])
_LOG_PLACE = np.hypot(_ACROSS, _DOWN) / _F(SEARCH.reach_place)
_SHARE, _NOISE, _SAME, _UNSEEN = _F(SEARCH.share), _F(SEARCH.noise), _F(SEARCH.same_px), _F(SEARCH.unseen)
_REACH, _STEPS = _F(1 / (3 * SEARCH.reach_colour)), SEARCH.steps
_COLOUR, _COLOUR_MOST = _F(SEARCH.colour / SEARCH.colour_most / 2), _F(SEARCH.colour_most)
_AGREE, _AGREE_PX = _F(SEARCH.agree / SEARCH.agree_px), _F(SEARCH.agree_px)
_PULL, _PULL_PX, _LEAST_PULL = _F(SEARCH.pull / SEARCH.pull_px), _F(SEARCH.pull_px), _F(SEARCH.least_pull)
_SMOOTH, _SMOOTH_PX = _F(SEARCH.smooth / 4 / SEARCH.smooth_px), _F(SEARCH.smooth_px)
_SMOOTH_COLOUR = _F(1 / (3 * SEARCH.smooth_colour))
_LEAST_SCALE, _LEAST_PARALLAX = _F(1e-3), _F(1e-6)


class Compared(NamedTuple):
    """A photo and its S sources, each a row but of A and b, which are the sources' alone.

    Attributes:
        grey: (1 + S, h·w) float32.
        colours: (1 + S, h·w·3) likewise, in one exposure.
        inverse: (1 + S, h·w) inverse depths of the sources' maps, negative where they know nothing; the first row is
            not read.
        A, b: (S, 3, 3) and (S, 3) float32: a pixel p = (x, y, 1) of inverse depth w lies in a source at A·p + w·b.
    """

    grey: NDArray
    colours: NDArray
    inverse: NDArray
    A: NDArray
    b: NDArray


@within
def _parallax(A: NDArray, b: NDArray, x: Number, y: Number, w: Number) -> Number:
    """Pixels that a point at (x, y) of inverse depth w moves in sources per inverse depth, the mean."""
    sum_, count = _ZERO, _ZERO
    for s in range(len(A)):
        z = A[s, 2, 0] * x + A[s, 2, 1] * y + A[s, 2, 2] + b[s, 2] * w
        if z < _LEAST_SCALE:
            continue
        u = (A[s, 0, 0] * x + A[s, 0, 1] * y + A[s, 0, 2] + b[s, 0] * w) / z
        v = (A[s, 1, 0] * x + A[s, 1, 1] * y + A[s, 1, 2] + b[s, 1] * w) / z
        across, down = b[s, 0] - u * b[s, 2], b[s, 1] - v * b[s, 2]
        sum_ += math.sqrt(across * across + down * down) / z
        count += _ONE
    return sum_ / max(count, _ONE) + _LEAST_PARALLAX


@within
def _unlike(colours: NDArray, here: Number, there: Number) -> Number:
    """Σ |difference| of two pixels' colours."""
    own, other = here * 3, there * 3
    apart = abs(colours[own] - colours[other]) + abs(colours[own + 1] - colours[other + 1])
    return apart + abs(colours[own + 2] - colours[other + 2])


@within
def _window(grey: NDArray, colours: NDArray, x: int, y: int, width: int, height: int, window: NDArray) -> Number:
    """Weights of the window about a pixel, and weights times grey, into window (2, taps); their total, mean grey and
    its variance.
    """
    total, sum_, squares = _ZERO, _ZERO, _ZERO
    here = y * width + x
    for k in range(_TAPS):
        across: Number = min(max(x + _I(_ACROSS[k]), 0), width - 1)
        down: Number = min(max(y + _I(_DOWN[k]), 0), height - 1)
        there = down * width + across
        weight = math.exp(-_unlike(colours, here, there) * _REACH - _LOG_PLACE[k])
        value = grey[there]
        window[0, k], window[1, k] = weight, weight * value
        total += weight
        sum_ += weight * value
        squares += weight * value * value
    mean = sum_ / total
    return total, mean, max(squares / total - mean * mean, _ZERO)


@within
def _colours_apart(
    colours: NDArray, at: tuple[Number, Number], size: tuple[int, int], own: tuple[Number, Number, Number]
) -> Number:
    """Σ |difference| of a colour and that of a source at (u, v)."""
    (u, v), (width, height) = at, size
    column: Number = min(_I(u - _HALF), width - 2)
    row: Number = min(_I(v - _HALF), height - 2)
    fp, fq = u - _HALF - _F(column), v - _HALF - _F(row)
    here = (row * width + column) * 3
    below_it = here + width * 3
    apart = _ZERO
    for c in range(3):
        above = colours[here + c] + fp * (colours[here + 3 + c] - colours[here + c])
        under = colours[below_it + c] + fp * (colours[below_it + 3 + c] - colours[below_it + c])
        apart += abs(above + fq * (under - above) - own[c])
    return apart


@within
def _source_cost(
    photos: Compared,
    source: int,
    plane: tuple[Number, Number, Number],
    pixel: tuple[int, int, int, int],
    own: tuple[Number, Number, Number],
    window: NDArray,
    seen: tuple[Number, Number, Number],
) -> Number:
    """What a plane costs in one source: 1 − NCC, colours and depth apart; negative where it lies outside its frame, or
    where the source knows nothing.

    Args:
        photos, source: the photo beside its sources, and which of these.
        plane: at the pixel.
        pixel: x, y, width, height.
        own: its colour.
        window: of `_window`, with what that says in `seen`: total, mean, variance.
    """
    grey, colours, inverse = photos.grey[source + 1], photos.colours[source + 1], photos.inverse[source + 1]
    A, b = photos.A[source], photos.b[source]
    w, right, below = plane
    x, y, width, height = pixel
    total, mean, variance = seen
    across, down = _F(x) + _HALF, _F(y) + _HALF
    # Of w = at + right·x + below·y, so that A + b·(right, below, at) is a homography
    at = w - right * across - below * down
    h00, h01, h02 = A[0, 0] + b[0] * right, A[0, 1] + b[0] * below, A[0, 2] + b[0] * at
    h10, h11, h12 = A[1, 0] + b[1] * right, A[1, 1] + b[1] * below, A[1, 2] + b[1] * at
    h20, h21, h22 = A[2, 0] + b[2] * right, A[2, 1] + b[2] * below, A[2, 2] + b[2] * at
    z = h20 * across + h21 * down + h22
    if not z > _LEAST_SCALE:
        return -_ONE
    u, v = (h00 * across + h01 * down + h02) / z, (h10 * across + h11 * down + h12) / z
    if not (u >= _HALF and v >= _HALF and u <= _F(width) - _HALF and v <= _F(height) - _HALF):
        return -_ONE
    row: Number = min(_I(v), height - 1)
    column: Number = min(_I(u), width - 1)
    its_depth = inverse[row * width + column]
    if its_depth < _ZERO:
        return -_ONE
    ux, uy = (h00 - u * h20) / z, (h01 - u * h21) / z  # the homography is affine about the middle, near enough
    vx, vy = (h10 - v * h20) / z, (h11 - v * h21) / z
    most_x, most_y = _F(width) - _F(1.001), _F(height) - _F(1.001)
    sum_, squares, products = _ZERO, _ZERO, _ZERO
    for k in range(_TAPS):
        p = min(max(u - _HALF + ux * _ACROSS[k] + uy * _DOWN[k], _ZERO), most_x)
        q = min(max(v - _HALF + vx * _ACROSS[k] + vy * _DOWN[k], _ZERO), most_y)
        left, top = np.int32(p), np.int32(q)
        fp, fq = p - _F(left), q - _F(top)
        first = np.uint64(top * width + left)
        second = first + np.uint64(width)
        above = grey[first] + fp * (grey[first + np.uint64(1)] - grey[first])
        under = grey[second] + fp * (grey[second + np.uint64(1)] - grey[second])
        value = above + fq * (under - above)
        sum_ += window[0, k] * value
        squares += window[0, k] * value * value
        products += window[1, k] * value
    mean_there = sum_ / total
    spread = max(squares / total - mean_there * mean_there, _ZERO)
    likeness = (products / total - mean * mean_there) / math.sqrt((variance + _NOISE) * (spread + _NOISE))
    apart = _colours_apart(colours, (u, v), (width, height), own)
    gap = abs(its_depth - w / z)
    shift_x, shift_y = b[0] - u * b[2], b[1] - v * b[2]
    moved = gap * math.sqrt(shift_x * shift_x + shift_y * shift_y)
    cost = min(_ONE - likeness, _ONE)
    cost += _COLOUR * (min(apart / _F(3), _COLOUR_MOST) + min(abs(mean - mean_there), _COLOUR_MOST))
    return cost + _AGREE * min(moved, _AGREE_PX)


@within
def _jumps_cost(
    planes: NDArray, colours: NDArray, plane: tuple[Number, Number, Number], x: int, y: int, px: Number
) -> Number:
    """What a plane costs for its jumps to the planes of neighbours; `px` as `_parallax` gives it."""
    (at, slope_x, slope_y), (_, height, width), here = plane, planes.shape, y * planes.shape[2] + x
    cost = _ZERO
    for k in range(4):
        dx, dy = _NEAR_X[k], _NEAR_Y[k]
        if not (0 <= x + dx < width and 0 <= y + dy < height):
            continue
        slope = (slope_x + planes[1, y + dy, x + dx]) * _F(dx)
        slope += (slope_y + planes[2, y + dy, x + dx]) * _F(dy)
        jump = abs(at + _HALF * slope - planes[0, y + dy, x + dx]) * px
        alike = math.exp(-_unlike(colours, here, here + dy * width + dx) * _SMOOTH_COLOUR)
        cost += _SMOOTH * alike * min(jump, _SMOOTH_PX)
    return cost


@within
def _tried(
    number: int, planes: NDArray, candidates: NDArray, best: tuple[Number, Number, Number], x: int, y: int, px: Number
) -> tuple[Number, Number, Number]:
    """A pixel's plane to try, by number: its own, those of its four neighbours, candidates, and steps about the best so
    far; beyond the frame, one behind everything.
    """
    _, height, width = planes.shape
    own, forward = (planes[0, y, x], planes[1, y, x], planes[2, y, x]), len(candidates)
    if number == 0:
        return own
    if number <= 4:
        dx, dy = _NEAR_X[number - 1], _NEAR_Y[number - 1]
        if not (0 <= x + dx < width and 0 <= y + dy < height):
            return -_ONE, own[1], own[2]
        slope_x, slope_y = planes[1, y + dy, x + dx], planes[2, y + dy, x + dx]
        return planes[0, y + dy, x + dx] - slope_x * _F(dx) - slope_y * _F(dy), slope_x, slope_y
    if number <= 4 + forward:
        return candidates[number - 5, y, x], own[1], own[2]
    step = number - 5 - forward
    return best[0] + _F((1 - 2 * (step % 2)) * (1 + step // 2)) / px, best[1], best[2]


@within
def _sorted_in(costs: NDArray, count: int, cost: Number) -> int:
    """Put a cost among so many, in rising order; how many there are then."""
    place = count
    while place > 0 and costs[place - 1] > cost:
        costs[place] = costs[place - 1]
        place -= 1
    costs[place] = cost
    return count + 1


@within
def _mean_of_better(costs: NDArray, count: int) -> Number:
    """What a plane costs in the better of the sources that see it, by so many costs in rising order."""
    if not count:
        return _UNSEEN
    counted: Number = max(1, math.ceil(_F(count) * _SHARE))
    sum_ = _ZERO
    for k in range(counted):
        sum_ += costs[k]
    return sum_ / _F(counted)


@compiled
def search(
    photos: Compared, planes: NDArray, first: NDArray, candidates: NDArray, low: Number, high: Number, spent: NDArray
) -> None:
    """Every pixel of a photo keeps the cheapest of its planes: every other one first, then those between.

    Args:
        photos: the photo beside its sources.
        planes: (3, h, w) float32, changed.
        first: (h, w) what the network found.
        candidates: (C, h, w) inverse depths to try, 0 where there are none; of none at all, the planes of neighbours
            and own steps are not tried either: then only `spent` changes.
        low, high: inverse depths between which it lies.
        spent: (h, w), set to what each pixel's plane costs.
    """
    _, height, width = planes.shape
    grey, colours = photos.grey[0], photos.colours[0]
    sources = len(photos.A)
    tries = 1 + 4 + len(candidates) + _STEPS if len(candidates) else 1
    window, costs = np.empty((2, _TAPS), _F), np.empty(max(sources, 1), _F)
    for red in range(2):
        for y in range(height):
            for x in range((y + red) % 2, width, 2):
                here = y * width + x
                seen = _window(grey, colours, x, y, width, height, window)
                pull = _PULL * (_LEAST_PULL + _NOISE / (seen[2] + _NOISE))
                px = _parallax(photos.A, photos.b, _F(x) + _HALF, _F(y) + _HALF, planes[0, y, x])
                own = colours[here * 3], colours[here * 3 + 1], colours[here * 3 + 2]
                best, least = (planes[0, y, x], planes[1, y, x], planes[2, y, x]), _FAR
                for number in range(tries):
                    plane = _tried(number, planes, candidates, best, x, y, px)
                    if number > 0 and not (low <= plane[0] <= high and abs(plane[0] - best[0]) * px >= _SAME):
                        continue
                    cost = pull * min(abs(plane[0] - first[y, x]) * px, _PULL_PX)
                    cost += _jumps_cost(planes, colours, plane, x, y, px)
                    if cost >= least:
                        continue
                    count = 0
                    for s in range(sources):
                        found = _source_cost(photos, s, plane, (x, y, width, height), own, window, seen)
                        if found >= 0:
                            count = _sorted_in(costs, count, found)
                    cost += _mean_of_better(costs, count)
                    if cost < least:
                        least, best = cost, plane
                planes[0, y, x], planes[1, y, x], planes[2, y, x] = best
                spent[y, x] = least


@compiled
def put(inverse: NDArray, to_photo: NDArray, shift: NDArray, out: NDArray) -> None:
    """The nearest of what a source's map puts into each pixel of a photo.

    Args:
        inverse: (h, w) float32, the source's inverse depths.
        to_photo, shift: (3, 3) and (3,) float64: a source's pixel p at depth z is the photo's to_photo·(z·p − shift).
        out: (h, w) float32, raised to the inverse depths that are put there.
    """
    height, width = inverse.shape
    for y in range(height):
        for x in range(width):
            if not inverse[y, x] > _ZERO:
                continue
            depth = 1.0 / np.float64(inverse[y, x])
            px, py = (x + 0.5) * depth - shift[0], (y + 0.5) * depth - shift[1]
            pz = depth - shift[2]
            z = to_photo[2, 0] * px + to_photo[2, 1] * py + to_photo[2, 2] * pz
            if not z > 1e-6:
                continue
            u = (to_photo[0, 0] * px + to_photo[0, 1] * py + to_photo[0, 2] * pz) / z
            v = (to_photo[1, 0] * px + to_photo[1, 1] * py + to_photo[1, 2] * pz) / z
            if 0 <= u < width and 0 <= v < height:
                column, row = _I(u), _I(v)
                out[row, column] = max(out[row, column], _F(1.0 / z))


@within
def _middle(values: NDArray) -> Number:
    """The median of an odd number of values, whose order changes (Hoare's quickselect)."""
    low, high, middle = 0, len(values) - 1, len(values) // 2
    while low < high:
        pivot, i, j = values[middle], low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while pivot < values[j]:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        if j < middle:
            low = i
        if middle < i:
            high = j
    return values[middle]


@compiled
def medians(values: NDArray, radius: int, out: NDArray) -> None:
    """Medians over (2·radius + 1)² pixels of (h, w), edges repeated."""
    height, width = values.shape
    side = 2 * radius + 1
    near = np.empty(side * side, _F)
    for y in range(height):
        for x in range(width):
            n = 0
            for dy in range(-radius, radius + 1):
                row = min(max(y + dy, 0), height - 1)
                for dx in range(-radius, radius + 1):
                    near[n] = values[row, min(max(x + dx, 0), width - 1)]
                    n += 1
            out[y, x] = _middle(near)
