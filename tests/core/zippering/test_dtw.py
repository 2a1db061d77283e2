"""Dynamic time warping against the plain recurrence, brute force over open ends, librosa and dtaidistance."""

from __future__ import annotations

import time
import tracemalloc

import naive
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mirror_scan.core.errors import MirrorScanError
from mirror_scan.core.zippering.dtw import dtw


def sequences(seed, n, m, dims=3, repeated=False):
    rng = np.random.default_rng(seed)
    x, y = rng.normal(size=(n, dims)), rng.normal(size=(m, dims))
    return (x.round(), y.round()) if repeated else (x, y)


def check_path(warping, x, y, skip=np.inf):
    """The path is monotone and contiguous, begins and ends where it may, and costs what is claimed."""
    path = warping.path
    assert path.ndim == 2 and path.dtype == np.int32
    steps = np.diff(path, axis=0)
    assert ((steps >= 0) & (steps <= 1)).all() and (steps.sum(axis=1) >= 1).all()
    (i0, j0), (i1, j1) = path[0], path[-1]
    assert min(i0, j0) == 0 and (i1 == len(x) - 1 or j1 == len(y) - 1)
    left = i0 + j0 + len(x) - 1 - i1 + len(y) - 1 - j1
    if np.isinf(skip):
        assert left == 0
    cost = np.linalg.norm(x[path[:, 0]] - y[path[:, 1]], axis=1).sum() + (skip * left if left else 0.0)
    assert warping.distance == pytest.approx(cost, rel=1e-9, abs=1e-12)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 14), st.integers(1, 14), st.integers(1, 5), st.booleans())
def test_matched_ends_against_the_recurrence(seed, n, m, dims, repeated):
    x, y = sequences(seed, n, m, dims, repeated)
    warping = dtw(x, y)
    assert warping.distance == pytest.approx(naive.dtw_distance(x, y), rel=1e-9, abs=1e-12)
    check_path(warping, x, y)


@settings(max_examples=40, deadline=None)
@given(
    st.integers(0, 2**32 - 1), st.integers(1, 7), st.integers(1, 7), st.sampled_from([0.0, 0.1, 0.7, 2.0, 50.0]),
    st.booleans(),
)  # fmt: skip
def test_open_ends_against_brute_force(seed, n, m, skip, repeated):
    x, y = sequences(seed, n, m, 2, repeated)
    warping = dtw(x, y, skip)
    assert warping.distance == pytest.approx(naive.open_dtw_distance(x, y, skip), rel=1e-9, abs=1e-12)
    check_path(warping, x, y, skip)


@pytest.mark.parametrize(("n", "m"), [(90, 61), (40, 150), (1, 30), (77, 77)])
def test_against_librosa(n, m):
    librosa = pytest.importorskip("librosa")
    x, y = sequences(n, n, m)
    x, y = x.cumsum(axis=0), y.cumsum(axis=0)
    expected = librosa.sequence.dtw(x.T, y.T, metric="euclidean", backtrack=False)[-1, -1]
    assert dtw(x, y).distance == pytest.approx(expected, rel=1e-9)


def test_against_dtaidistance():
    dtw_ndim = pytest.importorskip("dtaidistance.dtw_ndim")
    x, y = sequences(5, 60, 45)
    assert dtw(x, y).distance == pytest.approx(dtw_ndim.distance(x, y, inner_dist="euclidean"), rel=1e-9)


LARGEST, TINIEST = np.finfo(np.float64).max, np.nextafter(0.0, 1.0)
MAGNITUDES = (0.0, TINIEST, 1e-310, 1e-200, 1e-160, 1e-140, 1e-20, 1.0, 1e20, 1e150, 1e160, 1e200, 1e300, LARGEST)


def exact_distance(x, y, skip):
    """By brute force, in numbers whose exponent has room for squares."""
    x, y = np.asarray(x, np.longdouble), np.asarray(y, np.longdouble)
    n, m = len(x), len(y)
    total = np.full((n, m), np.inf, np.longdouble)
    best = np.longdouble(np.inf)
    for i in range(n):
        for j in range(m):
            before = [total[a, b] for a, b in ((i - 1, j), (i, j - 1), (i - 1, j - 1)) if a >= 0 and b >= 0]
            if i == j == 0:
                before = [np.longdouble(0)]
            elif np.isfinite(skip) and 0 in (i, j):
                before.append(np.longdouble(skip) * (i + j))
            total[i, j] = np.sqrt(((x[i] - y[j]) ** 2).sum()) + min(before)
            left = n - 1 - i + m - 1 - j
            if left == 0 or (np.isfinite(skip) and (i == n - 1 or j == m - 1)):
                best = min(best, total[i, j] + np.longdouble(skip if left else 0) * left)
    return best


wide = pytest.mark.skipif(np.finfo(np.longdouble).maxexp < 5000, reason="longdouble is float64 here")


@wide
@settings(max_examples=300, deadline=None)
@given(
    st.integers(0, 2**32 - 1), st.integers(1, 7), st.integers(1, 7), st.integers(1, 3),
    st.sampled_from([np.inf, 0.0, TINIEST, 1e-150, 0.5, 1e200, LARGEST]), st.sampled_from([1 << 26, 0]),
)  # fmt: skip
def test_any_finite_numbers(seed, n, m, dims, skip, memory):
    """Of all magnitudes at once: the right distance, or words where float64 cannot hold it."""
    rng = np.random.default_rng(seed)
    x, y = (
        rng.choice(MAGNITUDES, (k, dims)) * rng.choice([-1.0, 1.0], (k, dims)) * rng.choice([1.0, 0.7], (k, dims))
        for k in (n, m)
    )
    right = exact_distance(x, y, skip)
    try:
        warping = dtw(x, y, skip, memory)
    except MirrorScanError as error:
        assert right > 0.999 * LARGEST and "too large" in str(error)
        return
    path = warping.path
    assert abs(warping.distance - right) <= 1e-12 * right + 1e-316
    steps = np.diff(path, axis=0)
    assert ((steps >= 0) & (steps <= 1)).all() and (steps.sum(axis=1) >= 1).all()
    wide_x, wide_y = np.asarray(x, np.longdouble)[path[:, 0]], np.asarray(y, np.longdouble)[path[:, 1]]
    left = path[0].sum() + n - 1 + m - 1 - path[-1].sum()
    assert left == 0 or np.isfinite(skip)
    cost = np.sqrt(((wide_x - wide_y) ** 2).sum(axis=1)).sum() + np.longdouble(skip if left else 0) * left
    assert abs(cost - right) <= 1e-12 * right + 1e-316


@pytest.mark.parametrize("far", [LARGEST, -LARGEST, 1e155, np.finfo(np.float32).max, np.iinfo(np.int64).max])
def test_a_number_that_stands_for_no_value(far):
    """What many programs write; the process used to end."""
    warping = dtw(np.array([[0.0], [1.0], [far]]), np.array([[0.0], [2.0], [3.0]]))
    assert warping.distance == pytest.approx(abs(float(far)), rel=1e-6)
    assert warping.path[0].tolist() == [0, 0] and warping.path[-1].tolist() == [2, 2]


def test_a_far_vertex_may_be_skipped_and_the_rest_is_exact():
    x, y = np.array([[0.1], [0.2], [0.4]]), np.array([[0.1], [0.25], [0.4], [1e300]])
    assert dtw(x, y, skip=0.01).distance == pytest.approx(0.06, rel=1e-9)


@pytest.mark.parametrize("dtype", [np.int8, np.int64, np.uint16, np.float16, np.float32, bool, object, np.longdouble])
def test_numbers_of_any_type(dtype):
    x, y = np.array([[0], [1], [1]]).astype(dtype), np.array([[0], [1]]).astype(dtype)
    assert dtw(x, y).distance == 0


@pytest.mark.parametrize("x", [[["a"]], [[None]], [[1j]], [[10**400]], [[1.0], [1.0, 2.0]], None, "text", 3.0, [[]]])
def test_what_is_no_sequence_of_numbers_is_refused(x):
    with pytest.raises(MirrorScanError, match="dtw"):
        dtw(x, [[1.0]])
    if not isinstance(x, float):
        with pytest.raises(MirrorScanError, match="dtw"):
            dtw([[1.0]], [[1.0]], skip=x)


@pytest.mark.parametrize("memory", [-5, 0, 1, 17, 10**30])
def test_any_memory(memory):
    x, y = sequences(4, 60, 50)
    assert dtw(x, y, memory=memory).path.tolist() == dtw(x, y).path.tolist()


@pytest.mark.parametrize("skip", [np.inf, 0.3])
def test_symmetric_in_its_arguments(skip):
    for n, m in ((30, 20), (20, 30), (25, 25), (1, 9)):
        x, y = sequences(n + m, n, m)
        there, back = dtw(x, y, skip), dtw(y, x, skip)
        assert there.distance == pytest.approx(back.distance, rel=1e-12)
        check_path(there, x, y, skip)
        check_path(back, y, x, skip)


@pytest.mark.parametrize("skip", [np.inf, 0.5])
def test_identical_sequences_match_one_to_one(skip):
    x = np.random.default_rng(1).normal(size=(50, 3))
    warping = dtw(x, x.copy(), skip)
    assert warping.distance == 0
    np.testing.assert_array_equal(warping.path, np.column_stack((np.arange(50), np.arange(50))))


def test_all_points_equal():
    warping = dtw(np.ones((7, 3)), np.ones((4, 3)), 0.1)
    assert warping.distance == 0
    check_path(warping, np.ones((7, 3)), np.ones((4, 3)), 0.1)


def test_one_against_many():
    y = np.arange(5.0)[:, None]
    assert dtw(np.array([[2.0]]), y).path.tolist() == [[0, j] for j in range(5)]
    assert dtw(y, np.array([[2.0]])).path.tolist() == [[j, 0] for j in range(5)]
    assert dtw(y, np.array([[2.0]])).distance == 6
    # only the point itself is worth matching when the rest may be skipped for less
    cheap = dtw(np.array([[2.0]]), y, skip=0.25)
    assert cheap.distance == pytest.approx(1.0) and cheap.path.tolist() == [[0, 2]]


def test_a_shorter_stretch_finds_its_place():
    """A part of a curve matches where it was cut out; the rest of the curve stays unmatched."""
    s = np.linspace(0, 6, 200)
    curve = np.column_stack((np.cos(s), np.sin(s), s / 3))
    part = curve[60:120] + 1e-4
    warping = dtw(curve, part, skip=0.01)
    assert warping.path[0].tolist() == [60, 0] and warping.path[-1].tolist() == [119, 59]


def test_inputs_stay_as_they_are_and_any_layout_will_do():
    x, y = sequences(3, 40, 31)
    copies = x.copy(), y.copy()
    expected = dtw(x, y)
    views = dtw(np.asfortranarray(x), np.repeat(y, 2, axis=0)[::2])
    assert views.distance == expected.distance and np.array_equal(views.path, expected.path)
    assert dtw(x.tolist(), y.tolist()).distance == expected.distance
    assert np.array_equal(x, copies[0]) and np.array_equal(y, copies[1])


GOOD = np.zeros((4, 3))


@pytest.mark.parametrize(
    ("x", "y", "skip"),
    [
        (np.empty((0, 3)), GOOD, np.inf),
        (GOOD, np.empty((0, 3)), 1.0),
        (GOOD, np.zeros((4, 2)), np.inf),
        (GOOD, np.zeros(4), np.inf),
        (GOOD, np.where(np.eye(4, 3) > 0, np.nan, 0), np.inf),
        (np.where(np.eye(4, 3) > 0, np.inf, 0), GOOD, np.inf),
        (np.where(np.eye(4, 3) > 0, -np.inf, 0), GOOD, 1.0),
        (GOOD, GOOD, -0.1),
        (GOOD, GOOD, np.nan),
    ],
)
def test_refuses_what_has_no_warping(x, y, skip):
    with pytest.raises(MirrorScanError, match="dtw"):
        dtw(x, y, skip)


def test_large_input_in_bounded_memory():
    rng = np.random.default_rng(2)
    x, y = rng.normal(size=(3000, 3)).cumsum(axis=0), rng.normal(size=(2500, 3)).cumsum(axis=0)
    dtw(x[:5], y[:5])  # compiled
    tracemalloc.start()
    begin = time.perf_counter()
    warping = dtw(x, y)
    seconds = time.perf_counter() - begin
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    check_path(warping, x, y)
    assert peak < 24e6, "two bytes a cell at most, no matrix of floats"
    assert seconds < 3.0
