"""Kernels whose cache is damaged or cannot be kept, that are called by forks and by several threads."""

from __future__ import annotations

import errno
import importlib.util
import os
import pickle
import subprocess
import sys
import textwrap
from pathlib import Path

import numba
import numpy as np
import pytest
from mirror_scan.core.numeric import kernels
from numba.core import caching

SOURCE = """
from mirror_scan.core.numeric.kernels import njit

@njit(cache=True)
def double(x):
    return x + x
"""


@pytest.fixture
def run(tmp_path, monkeypatch, caplog):
    """Calls the kernel as a new process would; what it said, and how often the cache had the code."""
    (tmp_path / "module.py").write_text(SOURCE)
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "cache"))

    def call(value=3.0):
        monkeypatch.setattr(kernels, "_said", [])
        caplog.clear()
        spec = importlib.util.spec_from_file_location("module", tmp_path / "module.py")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        assert module.double(value) == 2 * value
        hits = sum(module.double.stats.cache_hits.values())
        return [record.getMessage() for record in caplog.records], hits

    call.files = lambda ending: list((tmp_path / "cache").rglob(f"*.{ending}"))
    return call


def empty(path):
    path.write_bytes(b"")


def cut(path):
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def cut_by_a_byte(path):
    path.write_bytes(path.read_bytes()[:-1])


def flipped(path):
    """Machine code with other bytes in it would end the process."""
    data = bytearray(path.read_bytes())
    for k in range(len(data) // 2, len(data) // 2 + 8):
        data[k] ^= 0xFF
    path.write_bytes(data)


def zeros(path):
    path.write_bytes(bytes(path.stat().st_size))


def garbage(path):
    path.write_bytes(np.random.default_rng(1).bytes(4000))


def of_another_python(path):
    path.write_bytes(pickle.dumps(numba.__version__) + b"cno_such_module\nNothing\n.")


def of_a_later_protocol(path):
    path.write_bytes(pickle.dumps(numba.__version__) + b"\x80\x63K\x01.")


def a_folder(path):
    path.unlink()
    path.mkdir()


DAMAGES = (empty, cut, cut_by_a_byte, flipped, zeros, garbage, of_another_python, of_a_later_protocol, a_folder)


@pytest.mark.parametrize("ending", ["nbi", "nbc"])
@pytest.mark.parametrize("damage", DAMAGES, ids=lambda damage: damage.__name__)
def test_damaged_code_is_compiled_again_with_one_warning(run, damage, ending):
    assert run() == ([], 0)
    assert run() == ([], 1)
    for path in run.files(ending):
        damage(path)
    said, hits = run()
    assert hits == 0 and len(said) == 1 and "damaged" in said[0] and "cache" in said[0]
    assert run() == ([], 1)
    assert not list(run.files("nbi")[0].parent.glob("*.tmp.*"))


def test_code_that_is_gone_is_compiled_again(run):
    run()
    for path in run.files("nbc"):
        path.unlink()
    assert run() == ([], 0)
    assert run() == ([], 1)


def test_an_index_that_numba_wrote_is_no_damage(run):
    """Of an earlier version of the program, in the same place."""
    run()
    for path in run.files("nbi"):
        path.write_bytes(pickle.dumps(numba.__version__) + pickle.dumps(("another source", {})))
    assert run() == ([], 0)
    for path in run.files("nbi"):
        path.write_bytes(pickle.dumps("0.1") + b"what that version wrote")
    assert run() == ([], 0)
    assert run() == ([], 1)


def test_code_of_two_types_is_kept_apart(run):
    assert run(3.0) == ([], 0)
    assert run(3) == ([], 0)
    assert run(2 + 1j) == ([], 0)
    assert run(3.0) == run(3) == run(2 + 1j) == ([], 1)


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES, errno.EIO])
def test_what_cannot_be_kept_is_compiled_in_memory_with_one_warning(run, monkeypatch, number):
    def fail(self, path, data):
        raise OSError(number, os.strerror(number))

    with monkeypatch.context() as patch:
        patch.setattr(kernels._Place, "_write", fail)
        for _ in range(2):
            said, hits = run()
            assert hits == 0 and len(said) == 1 and os.strerror(number) in said[0] and "NUMBA_CACHE_DIR" in said[0]
    assert run() == ([], 0)
    assert run() == ([], 1)


def test_a_full_disk_in_the_middle_of_a_file(run):
    """The file appears whole or not at all; what was there stays."""
    run()
    before = {path: path.read_bytes() for ending in ("nbi", "nbc") for path in run.files(ending)}
    resource = pytest.importorskip("resource")
    kept = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (100, kept[1]))
        said, hits = run(3)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, kept)
    assert hits == 0 and len(said) == 1
    assert {path: path.read_bytes() for ending in ("nbi", "nbc") for path in run.files(ending)} == before
    assert not list(run.files("nbi")[0].parent.glob("*.tmp.*"))


@pytest.mark.parametrize("where", ["a file", "below a file"])
def test_a_cache_folder_that_cannot_be_made(run, tmp_path, monkeypatch, where):
    (tmp_path / "file").write_text("")
    chosen = tmp_path / "file" / "below" if where == "below a file" else tmp_path / "file"
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(chosen))
    said, hits = run()
    assert hits == 0 and len(said) == 1 and str(chosen) in said[0]
    assert run() == ([], 1)  # it is beside the source


def test_a_folder_that_is_read_only_is_read(run, monkeypatch):
    run()

    def fail(dir=None):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    monkeypatch.setattr(caching.tempfile, "TemporaryFile", fail)  # numba's question whether a folder is of use
    assert run() == ([], 1)


def test_a_missing_cache_folder_is_made(run, tmp_path, monkeypatch):
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "not" / "yet"))
    assert run() == ([], 0)
    assert run() == ([], 1)


def test_numba_switched_off(tmp_path):
    done = python(tmp_path, "print(work(4))", NUMBA_DISABLE_JIT="1")
    assert done.stdout.split() == ["12.0"]


# --- forks and threads -----------------------------------------------------------------------------------------------

ROOT = Path(__file__).resolve().parents[3]
SHARED = (
    f"import runpy\nrunpy.run_path({str(ROOT / 'tests' / 'conftest.py')!r})\n"
    """
import concurrent.futures, multiprocessing, os, sys, threading
import numpy as np
from mirror_scan.core.numeric.kernels import njit
from mirror_scan.core.numeric.threads import each_range

@njit(cache=True, nogil=True)
def kernel(first, last, x, out):
    for i in range(first, last):
        out[i] = 2 * x[i]

def work(n):
    out = np.empty(n)
    each_range(kernel, n, np.arange(float(n)), out)
    return out.sum()

"""
)


def python(folder, text, **environment):
    (folder / "script.py").write_text(SHARED + textwrap.dedent(text))
    paths = os.pathsep.join(path for path in (str(Path(p).resolve()) for p in sys.path if p))
    variables = {"PYTHONPATH": paths, "NUMBA_CACHE_DIR": str(folder / "cache"), "NUMBA_NUM_THREADS": "2"}
    done = subprocess.run(
        [sys.executable, "-W", "ignore::DeprecationWarning", folder / "script.py"],
        env=os.environ | variables | environment,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0 and not done.stderr, (done.returncode, done.stderr)
    return done


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("kernels")


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
def test_forks_of_a_process_that_shared_out_work(folder):
    text = """
    def deep(n):
        with concurrent.futures.ThreadPoolExecutor(3) as pool:
            answers = list(pool.map(work, [n] * 6))
        reader, writer = os.pipe()
        if os.fork() == 0:
            os.write(writer, str(work(n)).encode())
            os._exit(0)
        os.wait()
        return [*answers, float(os.read(reader, 100))]

    if __name__ == "__main__":
        right = 999_000.0
        fork = multiprocessing.get_context("fork")
        with fork.Pool(2) as pool:  # of a process that has shared out nothing yet
            assert pool.map_async(work, [1000] * 4).get(60) == [right] * 4
        assert work(1000) == right
        with fork.Pool(2) as pool:
            assert pool.map_async(work, [1000] * 4).get(60) == [right] * 4
        with concurrent.futures.ProcessPoolExecutor(2, mp_context=fork) as pool:
            assert list(pool.map(deep, [1000] * 2)) == [[right] * 7] * 2
        child = fork.Process(target=work, args=(1000,))
        child.start()
        child.join(60)
        assert child.exitcode == 0
        assert work(1000) == right
    """
    python(folder, text)


def test_threads_call_kernels_at_the_same_time(folder):
    text = """
    if __name__ == "__main__":
        wrong = []

        def often():
            for _ in range(200):
                if work(20_000) != 399_980_000.0:
                    wrong.append(1)

        threads = [threading.Thread(target=often) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert not wrong
    """
    python(folder, text)


PARTS = """
import numpy as np
from mirror_scan.core.numeric.kernels import njit

@njit(cache=True)
def reciprocal(x):
    if x == 0.0:
        raise ValueError("there is no reciprocal of nothing")
    return 1.0 / x

@njit(cache=True)
def power(x, n):
    return 1.0 if n == 0 else x * power(x, n - 1)

@njit(cache=True, fastmath=True)
def total(numbers):
    whole = 0.0
    for number in numbers:
        whole += number
    return whole

@njit(cache=True)
def sum_of_reciprocals(numbers, n):
    each = np.empty(len(numbers))
    for k in range(len(numbers)):
        each[k] = power(reciprocal(numbers[k]), n)
    return total(each)
"""


def test_kernels_called_by_kernels_and_by_python(tmp_path):
    """Compiled in one process and read in others, whoever called first: errors that a part raises arrive too."""
    (tmp_path / "parts.py").write_text(PARTS)
    ask = textwrap.dedent(
        """
        import runpy, sys
        runpy.run_path(sys.argv[1])
        import numpy as np
        import parts
        for turn in sys.argv[2]:
            if turn == "k":
                assert parts.sum_of_reciprocals(np.array([1.0, 2.0, 4.0]), 2) == 1.3125
                try:
                    parts.sum_of_reciprocals(np.zeros(1), 1)
                except ValueError as error:
                    assert str(error) == "there is no reciprocal of nothing"
                else:
                    raise AssertionError("no error")
            else:
                assert parts.reciprocal(4.0) == 0.25 and parts.power(2.0, 3) == 8.0
                assert parts.total(np.ones(5)) == 5.0
        own = parts.sum_of_reciprocals, parts.reciprocal, parts.power, parts.total
        print(sum(sum(kernel.stats.cache_hits.values()) for kernel in own))
        """
    )
    conftest = Path(__file__).parents[2] / "conftest.py"

    def hits(turns, cache, before=""):
        told = subprocess.run(
            [sys.executable, "-c", before + ask, str(conftest), turns], text=True, capture_output=True, check=False,
            env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / cache), "PYTHONPATH": str(tmp_path)},
        )  # fmt: skip
        assert told.returncode == 0, told.stderr
        return int(told.stdout)

    assert hits("kp", "a") == 0
    assert hits("kp", "a") == hits("pk", "a") == 4
    assert hits("pk", "b") == 0
    assert hits("k", "b") == 1
    # A numba that is not known compiles in its own way, and neither reads what the other has kept.
    unknown = "import numba\nnumba.version_info = numba.version_info._replace(short=(9, 0))\n"
    assert hits("kp", "a", unknown) == 0 and hits("kp", "a", unknown) == 4
    assert hits("kp", "a") == 4
