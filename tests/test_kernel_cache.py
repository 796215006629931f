"""Machine code on disk is never outdated, never somebody else's, never damaged; and nobody waits without need."""

import errno
import fcntl
import os
import pickle
import shutil
import stat
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

from brownpipe import provenance
from brownpipe.engines import compiling, kernel_cache, kernels
from brownpipe.engines.compiled import KernelCall, disk_cache, file_of, is_compiled, seconds_to_compile
from brownpipe.engines.compiling import compile_all, one_compiler
from test_kernels import NOTE, Inner, Outer, work

REFUSED = "machine code is not kept in {}: "


@pytest.fixture
def told(monkeypatch):
    """What the listeners are told."""
    lines = []
    monkeypatch.setattr(kernel_cache, "on_compile", [lines.append])
    monkeypatch.setattr(kernel_cache, "remarks", [])
    monkeypatch.setattr(kernel_cache, "remarks_at_compiling", [])
    monkeypatch.setattr(kernel_cache, "_noted", set())
    monkeypatch.setattr(compiling, "remarks", kernel_cache.remarks)
    monkeypatch.setattr(compiling, "remarks_at_compiling", kernel_cache.remarks_at_compiling)
    return lines


@pytest.fixture
def places(tmp_path, monkeypatch):
    """The four folders in which machine code may be kept, best first, empty."""
    package, temporary = tmp_path / "package", tmp_path / "temporary"
    (package / "engines").mkdir(parents=True)
    temporary.mkdir()
    monkeypatch.setattr(kernel_cache, "PACKAGE", package)
    monkeypatch.setattr(kernel_cache.tempfile, "tempdir", str(temporary))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "chosen"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    own = tmp_path / "cache" if sys.platform != "darwin" else Path.home() / "Library" / "Caches"
    return (
        tmp_path / "chosen",
        package / "engines" / "__pycache__",
        own / "brownpipe",
        temporary / f"brownpipe-{os.geteuid()}",
    )


def open_to_all(place):
    """Make a folder that everybody can write to."""
    place.mkdir(parents=True, exist_ok=True)
    place.chmod(0o777)


def unwritable(place):
    """Put a file in the place of a folder, so that not even root can make it."""
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_text("")


def folder_of(module="engines.kernels"):
    return kernel_cache.folder_of.__wrapped__(module)


# -- which folder ---------------------------------------------------------------------------------------------------


@pytest.mark.promise(
    "another user can write to a folder of machine code",
    "machine code is kept in, and loaded from, folders that this user alone can write to; another one is skipped, and "
    "a line says why",
)
@pytest.mark.parametrize("spoil", [open_to_all, unwritable])
@pytest.mark.parametrize("spoilt", [0, 1, 2, 3, 4])
def test_the_first_folder_that_only_this_user_can_write_to_is_taken(places, told, spoil, spoilt):
    for place in places[:spoilt]:
        spoil(place)
    folder = folder_of()
    assert (folder is None) == (spoilt == 4)
    if folder is not None:
        assert folder.parent == places[spoilt] and stat.S_IMODE(folder.stat().st_mode) == 0o700
    lines = [*kernel_cache.remarks, *kernel_cache.remarks_at_compiling]
    refused = places[:spoilt] if spoil is open_to_all else ()
    assert [path for place in refused for path in place.iterdir()] == []
    assert [line.startswith(REFUSED.format(place)) for line, place in zip(lines, refused, strict=False)] == [
        True for _ in refused
    ]
    assert len(lines) == len(refused) + (folder is None)


@pytest.mark.promise(
    "machine code made from an older source",
    "an edit of any source file gives machine code another folder, in every place; without a safe place machine code "
    "is made in memory, and Numba's own cache, which does not notice such edits, is never used",
)
@pytest.mark.parametrize("spoilt", [0, 1, 2, 3, 4])
def test_after_an_edit_old_machine_code_is_not_found(places, told, tmp_path, monkeypatch, spoilt):
    for place in places[:spoilt]:
        open_to_all(place)
    copy = Path(shutil.copytree(provenance.PACKAGE, tmp_path / "brownpipe", ignore=shutil.ignore_patterns("*cache__")))
    monkeypatch.setattr(kernel_cache, "sources", lambda module: provenance.sources(module, folder=copy))
    before = folder_of("engines.exact.events")
    with open(copy / "engines" / "collisions.py", "a") as file:
        file.write("# edited\n")
    after = folder_of("engines.exact.events")
    if spoilt < 4:
        assert before.parent == after.parent == places[spoilt] and before != after
    else:
        assert before is after is None


@pytest.mark.parametrize("folder", [None, "code"])
def test_numbas_own_cache_is_never_used(tmp_path, monkeypatch, folder):
    folder = tmp_path / folder if folder else None
    monkeypatch.setattr(kernel_cache, "folder_of", lambda _: folder)
    made = kernels.entry_point(work.py_func)
    assert made.stats.cache_path == (str(folder) if folder else None)


def test_a_line_on_a_folder_is_told_once_and_by_default_only_to_those_who_compile(places, told):
    for place in places[:2]:
        open_to_all(place)
    for _ in range(2):
        folder_of()
        compile_all([])
    (chosen,) = told
    assert chosen.startswith(REFUSED.format(places[0])) and "mode 777; chmod go-w cures it" in chosen
    first_kernel = compiling._FirstKernel()
    for _ in range(2):
        first_kernel.on_start(None)
    assert [line.partition(":")[0] for line in told[1:]] == [
        "compiling the kernels for this kind of scene, once per machine",
        REFUSED.format(places[1]).partition(":")[0],
    ]


@pytest.mark.parametrize("umask", [0o000, 0o002, 0o077])
def test_own_folders_are_private_whatever_the_umask(places, umask):
    before = os.umask(umask)
    try:
        folder = folder_of()
        path = kernel_cache.DiskCache(folder, work).folder / "code.nbc"
        kernel_cache.write(path, b"code")
    finally:
        os.umask(before)
    assert folder.parent == places[0] and kernel_cache.read(path) == b"code"


@pytest.mark.promise(
    "another user can write to a folder of machine code",
    "the check covers owner and mode of the folder and of every folder above it",
)
def test_who_can_write_to_a_folder_or_above_it_is_found_for_any_modes(tmp_path, faults):
    """A folder above may be open to all if it is sticky, like /tmp: only the owner of a file can replace it there."""
    levels = [tmp_path / "a", tmp_path / "a" / "b", tmp_path / "a" / "b" / "c"]
    levels[-1].mkdir(parents=True)
    for _ in faults.tries(200):
        modes = [0o700 | faults.random.choice([0, 0o55, 0o20, 0o02, 0o77, 0o1077, 0o2070]) for _ in levels]
        for level, mode in zip(levels, modes, strict=True):
            level.chmod(mode)
        is_safe = not modes[-1] & 0o022 and all(mode & 0o1000 or not mode & 0o022 for mode in modes[:-1])
        assert (kernel_cache.why_unsafe(levels[-1]) is None) == is_safe, [oct(mode) for mode in modes]
    for level in levels:
        level.chmod(0o700)
    assert kernel_cache.why_unsafe(levels[-1]) is None
    (tmp_path / "link").symlink_to(levels[-1])
    assert "is not a folder" in kernel_cache.why_unsafe(tmp_path / "link")


def test_folders_and_files_of_another_user_are_not_trusted(tmp_path, monkeypatch):
    """Here this user becomes another one. What belongs to root is trusted, as are folders above."""
    file = tmp_path / "code.nbc"
    kernel_cache.write(file, b"code")
    owner = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: owner + 4321)
    monkeypatch.setattr(kernel_cache, "ROOT", 0 if owner else -1)
    assert kernel_cache.read(file) is None
    assert f"belongs to user {owner}" in kernel_cache.why_unsafe(tmp_path)
    monkeypatch.setattr(kernel_cache, "ROOT", owner)
    assert kernel_cache.read(file) == b"code"


# -- which files ----------------------------------------------------------------------------------------------------


class Planted:
    """Touches a file when it is loaded by pickle."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)


@pytest.fixture
def kept(tmp_path):
    """A call of an entry point with its own folder for machine code, which is still empty."""
    made = kernels.entry_point(work.py_func)
    made._cache = kernel_cache.DiskCache(tmp_path / "code", work.py_func)
    return KernelCall(made, (Outer(2.0, Inner(3, np.zeros(0)), None, np.zeros(0)),), 1.0)


def types_of(call):
    return tuple(map(call.function.typeof_pyval, call.arguments))


@pytest.mark.promise(
    "a planted file of machine code",
    "a file that others can write to, a link, a FIFO or a folder in place of machine code is never opened as such",
)
def test_a_planted_file_is_not_loaded(kept, tmp_path):
    file, mark = file_of(kept), tmp_path / "executed"
    kernel_cache.write(file, pickle.dumps(Planted(mark)))
    aside = file.rename(tmp_path / "aside")
    for plant in (
        lambda: [shutil.copy(aside, file), file.chmod(0o666)],
        lambda: [shutil.copy(aside, file), file.chmod(0o620)],
        lambda: file.symlink_to(aside),
        lambda: os.mkfifo(file, 0o600),
    ):
        plant()
        assert not is_compiled(kept)
        assert disk_cache(kept).load_overload(types_of(kept), kept.function.targetctx) is None
        file.unlink()
    file.mkdir()
    assert kernel_cache.read(file) is None and not mark.exists()


@pytest.mark.promise(
    "damaged machine code",
    "a file of machine code with any changed, missing or additional byte, or with the name of another one, is not "
    "executed but made again",
)
def test_damaged_machine_code_is_never_loaded(tmp_path, faults):
    file = tmp_path / "code.nbc"
    kernel_cache.write(file, faults.random.randbytes(3000))
    good = file.read_bytes()
    for _ in faults.tries(300):
        place = faults.random.randrange(len(good))
        changed = bytearray(good)
        changed[place] ^= 1 << faults.random.randrange(8)
        file.write_bytes(faults.random.choice([changed, good[:place], good + good[:place] + b"0", good[place + 1 :]]))
        assert kernel_cache.read(file) is None
    file.write_bytes(good)
    assert kernel_cache.read(file) is not None
    assert kernel_cache.read(file.rename(tmp_path / "other.nbc")) is None


def test_machine_code_is_made_once_kept_and_made_again_if_damaged(kept, told):
    assert list(seconds_to_compile([kept]).values()) == [1.0]
    for _ in range(2):
        compile_all([kept])
        assert is_compiled(kept) and len(told) == 1
    file = file_of(kept)
    good = file.read_bytes()
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    again = kernels.entry_point(work.py_func)
    again._cache = disk_cache(kept)
    file.write_bytes(good[:-1])
    assert list(seconds_to_compile([kept._replace(function=again)]).values()) == [1.0]
    compile_all([kept._replace(function=again)])
    assert len(told) == 2 and kernel_cache.read(file) is not None


def test_variants_have_files_of_their_own(kept, monkeypatch):
    other = kept._replace(arguments=(Outer(2.0, Inner(3, np.zeros(0, int)), None, np.zeros(0)),))
    files = {file_of(kept), file_of(other)}
    monkeypatch.setattr(kernel_cache, "VERSIONS", ("other",))
    files.add(file_of(kept))
    monkeypatch.setattr(kernel_cache.numba.config, "BOUNDSCHECK", 1)
    files.add(file_of(kept))
    monkeypatch.setattr(kept.function.targetctx.codegen(), "magic_tuple", lambda: ("other", "processor"))
    files.add(file_of(kept))
    assert len(files) == 5


def test_if_machine_code_cannot_be_written_the_run_goes_on(kept, told, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(kernel_cache, "write", full)
    compile_all([kept])
    assert told[1:] == [f"machine code is not kept: {disk_cache(kept).folder}: No space left on device"]
    assert kept.function(*kept.arguments) == 0.0


def test_a_signal_while_machine_code_is_written_leaves_no_file(tmp_path, monkeypatch):
    opened = os.open

    def interrupted(path, flags, *arguments, **options):
        os.close(opened(path, flags, *arguments, **options))
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "open", interrupted)
    with pytest.raises(KeyboardInterrupt):
        kernel_cache.write(tmp_path / "code" / "one.nbc", b"code")
    assert list((tmp_path / "code").iterdir()) == []


# -- which folders are removed --------------------------------------------------------------------------------------


def test_machine_code_that_nobody_uses_is_removed(tmp_path):
    """Of three folders the one unused for a day; not one whose lock is held, nor what is not ours."""
    for name in ("kernels-old", "kernels-new", "kernels-held", "other"):
        (tmp_path / name).mkdir()
        (tmp_path / name / kernel_cache.MARK).touch()
        (tmp_path / name / "code.nbc").touch()
    for name in ("kernels-old", "kernels-held", "other"):
        os.utime(tmp_path / name / kernel_cache.MARK, (time.time() - 2 * kernel_cache.UNUSED,) * 2)
    with open(tmp_path / "kernels-held" / kernel_cache.MARK) as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        kernel_cache._prune(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["kernels-held", "kernels-new", "other"]


def test_using_machine_code_keeps_it_from_being_removed(tmp_path):
    cache = kernel_cache.DiskCache(tmp_path / "kernels-used", work.py_func)
    cache.folder.mkdir()
    made = kernels.entry_point(work.py_func)
    made._cache = cache
    call = KernelCall(made, (Outer(2.0, Inner(3, np.zeros(0)), None, np.zeros(0)),), 1.0)
    for _ in range(2):
        compile_all([call])
        os.utime(cache.folder / kernel_cache.MARK, (0, 0))
    compile_all([call])
    kernel_cache._prune(tmp_path)
    assert cache.folder.exists()


# -- who waits for whom ---------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.promise(
    "another process holds the locks of compiling",
    "a process whose machine code is on disk takes no lock and runs at once",
)
def test_with_machine_code_on_disk_nobody_waits(tmp_path):
    """Here a whole process, with the machine code of the exact engine in a folder of which every file is locked."""
    from brownpipe.engines.exact import run as exact
    from brownpipe.scene import read_scene

    calls = exact.kernel_calls(read_scene(NOTE))
    compile_all(calls)
    for call in calls:
        folder = disk_cache(call).folder
        shutil.copytree(folder, tmp_path / "cache" / folder.name, dirs_exist_ok=True)
        for name in (kernel_cache.MARK, f"{file_of(call).name}.lock", "saving"):
            (tmp_path / "cache" / folder.name / name).touch()
    with ExitStack() as held:
        files = [held.enter_context(open(path)) for path in (tmp_path / "cache").rglob("*") if path.is_file()]
        for file in files:
            fcntl.flock(file, fcntl.LOCK_EX)
        assert len(files) > 6
        done = subprocess.run(
            [sys.executable, "-m", "brownpipe", "simulate", str(NOTE), "--output", "x.h5"],
            env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")},
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.slow
@pytest.mark.promise(
    "another process compiles for minutes, or is stopped while it compiles",
    "who waits is told for which process and kernel, and compiles by itself after a minute",
)
def test_who_waits_is_told_for_whom_and_not_for_ever(tmp_path, told, monkeypatch):
    monkeypatch.setattr(compiling, "SILENT_WAIT", 0.1)
    monkeypatch.setattr(compiling, "LONGEST_WAIT", 0.4)
    file = tmp_path / "code.nbc"
    with one_compiler(file, "advance"):
        assert stat.S_IMODE(Path(f"{file}.lock").stat().st_mode) == 0o600
        began = time.monotonic()
        with one_compiler(file, "advance"):
            assert time.monotonic() - began >= 0.4
        with one_compiler(tmp_path / "other.nbc", "advance"):
            pass
    with one_compiler(file, "advance"):
        pass
    who = f"process {os.getpid()} on {os.uname().nodename}"
    first, last = told
    assert first == f"waiting for {who}, which compiles the kernel advance; for 0 s at most"
    assert last.startswith(f"{who} has compiled the kernel advance for") and last.endswith("it is compiled here, too")


@pytest.mark.promise(
    "a file system without locks",
    "kernels are compiled without a lock, and their files are complete whoever writes them",
)
@pytest.mark.parametrize("number", [errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EIO])
def test_without_locks_kernels_are_compiled_all_the_same(tmp_path, told, monkeypatch, number):
    def refuse(*_):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(compiling.fcntl, "flock", refuse)
    with one_compiler(tmp_path / "code.nbc", "advance"):
        pass
    kernel_cache._prune(tmp_path)
    assert told == []


def test_without_a_place_for_the_lock_kernels_are_compiled_all_the_same(tmp_path):
    unwritable(tmp_path / "code")
    with one_compiler(tmp_path / "code" / "code.nbc", "advance"):
        pass


def test_without_a_place_to_write_nothing_is_locked(tmp_path, monkeypatch, told):
    monkeypatch.setattr(kernel_cache, "folder_of", lambda _: None)
    monkeypatch.setattr(compiling, "one_compiler", None)
    made = kernels.entry_point(work.py_func)
    compile_all([KernelCall(made, (Outer(2.0, Inner(3, np.zeros(0)), None, np.zeros(0)),), 1.0)])
    assert len(made.overloads) == 1
