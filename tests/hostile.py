"""Files made by a bug or to do harm: random changes of valid ones, with seals and digests made valid again."""

import json
import os
import re
import resource
import signal
import sys
import warnings
import zlib
from pathlib import Path

import h5py
import numpy as np

from brownpipe.errors import StorageError
from brownpipe.storage import files, hdf5
from brownpipe.storage.admission import DEEPEST, opened

DIGEST = re.compile(rb"[0-9a-f]{64}")
NUMBERS = [np.nan, np.inf, -np.inf, -1, 0, 1, 2**31, 2**62, -(2**63), 1e300, 1e-300, 5e-324, -0.0]
TEXTS = [
    *("", "\n", "[" * 100_000, '{"a":' * 5000, "null", "[]", "{}", '{"box": 1}', "NaN", "9" * 5000, "1e999", "\x1b[2J"),
    *("x" * 300_000, '{"name": "exact"}', "../../etc/passwd", "--output", "\ud800", "exact", "-1", "true", '"text"'),
]
SCALARS = [
    *("1e-300", "1e-320", "1e308", "1e999", ".nan", "-.inf", "-1", "0", str(2**63), str(10**40), "1_000", "0x10"),
    *("null", "''", "[]", "{}", "[[[]]]", '"\\0"', '"\\ud800"', "text", "x" * 5000, "~", "true", "10000000", "!!a b"),
    *("&a 1", "*a", "- 1", "2e-323", "[1, 2, 3]", "{a: {b: c}}", '"../../etc/passwd"', "1 %", "1e-300 %", "exact"),
]


class Ended(tuple):
    """How a forked process ended: exit status (negative: the signal), what it wrote, and its CPU seconds."""

    status, printed, errors, seconds = (property(lambda self, k=k: self[k]) for k in range(4))


def in_child(function, folder, memory=400 * 2**20, seconds=15):
    """Call a function in a forked process, with so many more bytes of address space and so many CPU seconds."""
    outputs = [Path(folder) / name for name in ("printed", "errors")]
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    began = resource.getrusage(resource.RUSAGE_CHILDREN)
    sys.stdout.flush()
    sys.stderr.flush()
    child = os.fork()
    if child == 0:
        status = 99
        try:
            signal.signal(signal.SIGALRM, signal.SIG_DFL)
            signal.alarm(20 * seconds)  # the machine may be busy
            resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            resource.setrlimit(resource.RLIMIT_AS, (used + memory, used + memory))
            for stream, path in enumerate(outputs, start=1):
                os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), stream)
            sys.stdout, sys.stderr = (os.fdopen(os.dup(stream), "w", errors="replace") for stream in (1, 2))
            os.chdir(folder)
            warnings.simplefilter("default")  # as outside of the tests
            status = function()
        except SystemExit as left:
            status = left.code
        except BaseException:
            import traceback

            traceback.print_exc()
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(status)
    _, status = os.waitpid(child, 0)
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    texts = [path.read_text(errors="replace") for path in outputs]
    return Ended((os.waitstatus_to_exitcode(status), *texts, ended.ru_utime - began.ru_utime))


def resealed(contents):
    """The bytes of an HDF5 file with the digest of its present nodes, where it has one, and a valid seal."""
    seals = [*files.SEAL.finditer(contents)]
    if len(seals) != 1:
        return contents
    contents = contents[: seals[0].start()] + files.BLANK_SEAL.encode() + contents[seals[0].end() :]
    with h5py.File.in_memory(contents) as file:
        try:
            group = next((file[name] for name in ("parameters", "checkpoint") if name in file), None)
            stored = None if group is None else group.attrs.get("contents_digest")
        except (KeyError, OSError, RuntimeError):  # a link that leads nowhere, or to itself
            stored = None
    if isinstance(stored, str) and contents.count(stored.encode()) == 1:
        try:
            with opened(contents) as admitted:
                items = admitted.members()
                small = sum(item.nbytes for item in items.values() if isinstance(item, h5py.Dataset)) < 2**24
                nodes = hdf5.nodes_of(admitted, items) if small else {}
        except StorageError:  # the reader refuses these nodes, too
            nodes = {}
        contents = contents.replace(stored.encode(), hdf5.digest(nodes).encode())
    return files.seal(contents)


def changed_tree(contents, random, path):
    """The bytes of an HDF5 file with some random changes of its tree, and what they are."""
    path.write_bytes(contents)
    done = []
    with h5py.File(path, "r+") as file:
        names = []
        file.visit(names.append)  # before the changes: in a deep tree it takes seconds
        for _ in range(random.choice([1, 1, 1, 2, 5])):
            name = random.choice([*names, "new"])
            change = random.choice(CHANGES)
            try:
                change(file, name, random)
                done.append(f"{change.__name__} {name}")
            except (KeyError, OSError, RuntimeError, TypeError, ValueError, AttributeError) as error:
                done.append(f"{change.__name__} {name}: not possible ({type(error).__name__})")
    return resealed(path.read_bytes()), done


def _replace(file, name, **more):
    """Put a dataset in place of an object; its attributes, dimension scales too, stay if it was a dataset."""
    attributes = dict(file[name].attrs) if name in file else {}
    if name in file:
        del file[name]
    dataset = file.create_dataset(name, **more)
    for key, value in attributes.items():
        if key not in hdf5.SCALE_ATTRIBUTES - {"DIMENSION_LIST"}:
            dataset.attrs[key] = value


def delete(file, name, random):
    del file[name]


def numbers(file, name, random):
    """One or all numbers of a dataset become strange ones."""
    values = np.array(file[name][()])
    strange = random.choice(NUMBERS)
    with np.errstate(all="ignore"):
        strange = np.array(strange).astype(values.dtype)
    if values.ndim and values.size and random.random() < 0.6:
        values[tuple(random.randrange(n) for n in values.shape)] = strange
    else:
        values[...] = strange
    file[name][...] = values


def other_type(file, name, random):
    values = np.asarray(file[name][()])
    kind = random.choice(["f4", "f8", ">f8", "i1", "i8", "u8", "c16", "S5", "f2", "g", "bool", "V9", "text", "table"])
    if kind == "text":
        values = np.full(values.shape, "text", h5py.string_dtype())
    elif kind == "table":
        values = np.zeros(values.shape, [("a", "f8", (2,)), ("b", "S3")])
    else:
        with np.errstate(all="ignore"):
            values = np.zeros(values.shape, kind) if values.dtype.kind in "OS" else values.astype(kind)
    _replace(file, name, data=values)


def other_shape(file, name, random):
    values = np.asarray(file[name][()])
    shapes = [(), (0,), (1,), (3,), values.shape[::-1], (*values.shape, 1), (1, *values.shape), (2, 2, 2, 2)]
    shapes += [tuple(n + 1 for n in values.shape), tuple(max(n - 1, 0) for n in values.shape)]
    _replace(file, name, data=np.resize(values, random.choice(shapes)))


def huge(file, name, random):
    """A size whose values are not stored: chunks that do not exist, or a contiguous dataset never written."""
    kind = random.choice(["f8", "i4", "u1", h5py.string_dtype()])
    shape = random.choice([(430_000_000,), (10**6, 10**3), (2**40,), (21, 4, 2**33), (2**62,)])
    chunks = (2**10,) * len(shape)
    layouts = [
        {"chunks": True, "compression": "gzip"},
        {"chunks": True},
        {},
        {"chunks": chunks, "maxshape": (None,) * len(shape)},
    ]
    layout = random.choice(layouts)
    if not layout and shape == (2**62,):  # more bytes than HDF5 can count
        kind = "u1"
    _replace(file, name, shape=shape, dtype=kind, **layout)


def bomb(file, name, random):
    """A chunk that is decompressed to 2 GB or, in many chunks of zeros, a large dataset."""
    packer = zlib.compressobj(9)
    first, block = (packer.compress(bytes(2**20)) + packer.flush(zlib.Z_FULL_FLUSH) for _ in range(2))
    if random.random() < 0.5:
        _replace(file, name, shape=(100,), dtype="f8", chunks=(100,), compression="gzip")
        file[name].id.write_direct_chunk((0,), first + 2048 * block)
    else:
        _replace(file, name, shape=(2**20 * 300,), dtype="f8", chunks=(2**20,), compression="gzip")
        packed = zlib.compress(bytes(2**23), 1)
        for k in range(300):
            file[name].id.write_direct_chunk((k * 2**20,), packed)


def foreign_filter(file, name, random):
    values = np.resize(np.asarray(file[name][()]), (64,))
    _replace(file, name, data=values, **random.choice([{"compression": "lzf"}, {"scaleoffset": 3}]))


def elsewhere(file, name, random):
    """Values of another file: external storage, or a virtual dataset."""
    shape = file[name].shape if name in file and isinstance(file[name], h5py.Dataset) else (8,)
    if random.random() < 0.5:
        _replace(file, name, shape=shape, dtype="u1", external=[("/etc/passwd", 0, h5py.h5f.UNLIMITED)])
    else:
        if name in file:
            del file[name]
        layout = h5py.VirtualLayout(shape, "f8")
        layout[...] = h5py.VirtualSource(random.choice([".", "/tmp/other.h5"]), "parameters", shape)
        file.create_virtual_dataset(name, layout)


def link(file, name, random):
    if name in file and random.random() < 0.7:
        del file[name]
    names = [*file, "nowhere"]
    other = file[random.choice(names)] if random.random() < 0.3 else None
    links = [h5py.SoftLink("/" + random.choice(names)), h5py.SoftLink(f"/{name}"), file["/"], other or file["/"]]
    links += [h5py.ExternalLink(random.choice(["/etc/passwd", "/dev/zero", "runs.h5"]), "/parameters")]
    file[name if name not in file else f"{name}/more"] = random.choice(links)


def deep(file, name, random):
    file.create_group("/".join([name if isinstance(file.get(name), h5py.Group) else "deep", *["d"] * (200 * DEEPEST)]))


def many_links(file, name, random):
    for k in range(3000):
        file[f"more{k}"] = file[name]


def odd_object(file, name, random):
    if name in file:
        del file[name]
    if random.random() < 0.3:
        file[name] = np.dtype("f8")
    elif random.random() < 0.5:
        file.create_dataset(name, data=h5py.Empty(random.choice(["f8", h5py.string_dtype()])))
    else:
        kinds = [h5py.vlen_dtype("f8"), h5py.ref_dtype, h5py.regionref_dtype, h5py.enum_dtype({"a": 1}, "i4")]
        file.create_dataset(name, (4,), random.choice(kinds))


def text(file, name, random):
    """Text in place of any dataset, or a strange one in place of text."""
    _replace(file, name, data=random.choice(TEXTS).encode(errors="surrogatepass"), dtype=h5py.string_dtype())


def scene_text(file, name, random):
    """One value of the scene or of the settings is replaced; the digest of the scene is not stored."""
    name = random.choice(["parameters/scene", "parameters/settings"])
    mapping = json.loads(file[name][()])
    place, parent = mapping, None
    while isinstance(place, dict | list) and place and random.random() < 0.8:
        key = random.choice(list(place) if isinstance(place, dict) else range(len(place)))
        parent, place = (place, key), place[key]
    if parent is not None:
        parent[0][parent[1]] = random.choice([*NUMBERS, "", "text", [], {}, None, True, [1, 2], {"a": 1}, 10**40, 1e-9])
    _replace(file, name, data=json.dumps(mapping), dtype=h5py.string_dtype())


def attribute(file, name, random):
    """An attribute is deleted or becomes strange; that with the seal is left."""
    item = file[name] if name in file and random.random() < 0.5 else file[random.choice(["/", *file])]
    names = [key for key in item.attrs if key != "seal"]
    key = random.choice([*names, "units"])
    if key in item.attrs and random.random() < 0.3:
        del item.attrs[key]
        return
    values = [*NUMBERS, *TEXTS[:8], np.zeros((3, 2)), h5py.Empty("f8"), np.array(["a", "b"], h5py.string_dtype())]
    values += [file["/"].ref, np.zeros(2, [("a", "f8")]), b"\xff\xfe", np.array([], "f8"), 1 + 2j]
    value = random.choice(values)
    if isinstance(value, int):
        value = np.array(value).astype(np.int64)
    item.attrs.create(key, value)


CHANGES = [delete, numbers, numbers, other_type, other_shape, huge, bomb, foreign_filter, elsewhere, link, deep]
CHANGES += [many_links, odd_object, text, scene_text, scene_text, attribute, attribute]


def changed_bytes(contents, random):
    """Some bytes overwritten, cut, doubled or put in; not sealed again."""
    contents = bytearray(contents)
    for _ in range(random.choice([1, 1, 3, 10])):
        place, length = random.randrange(len(contents)), random.choice([1, 1, 8, 100])
        strange = random.choice([random.randbytes(length), bytes(length), b"\xff" * length, b"\n[{&*", b"\x1b]0;x\x07"])
        end = place + random.choice([0, len(strange), length, len(contents)])
        contents[place:end] = strange
        contents = contents or bytearray(b" ")
    return bytes(contents)


def changed_metadata(contents, random, folder):
    """Some bytes changed where most are HDF5's own, with a valid seal and, if the file can be read, a valid digest."""
    with h5py.File.in_memory(contents) as file:
        ours = np.frombuffer(contents, np.uint8) > 0
        datasets = []
        file.visititems(lambda _, item: datasets.append(item) if isinstance(item, h5py.Dataset) else None)
        for item in datasets:
            if item.chunks is not None:
                item.id.chunk_iter(lambda chunk: _clear(ours, chunk.byte_offset, chunk.size))
            elif item.id.get_offset() is not None:
                _clear(ours, item.id.get_offset(), item.id.get_storage_size())
    (seal,) = files.SEAL.finditer(contents)
    _clear(ours, seal.start(), seal.end() - seal.start())
    changed = bytearray(contents)
    for place in random.choices(np.flatnonzero(ours).tolist(), k=random.choice([1, 1, 2, 4])):
        changed[place] = random.choice([0, 1, 127, 128, 255, changed[place] ^ 1 << random.randrange(8)])
    sealed = Path(folder) / "sealed"
    ended = in_child(lambda: sealed.write_bytes(resealed(bytes(changed))) * 0, folder)  # HDF5 may crash
    blank = changed[: seal.start()] + files.BLANK_SEAL.encode() + changed[seal.end() :]
    return sealed.read_bytes() if ended.status == 0 else files.seal(bytes(blank))


def _clear(flags, start, size):
    flags[start : start + size] = False


def changed_yaml(contents, random):
    """A scene or study with one or several values replaced by strange ones."""
    if random.random() < 0.3:
        return changed_bytes(contents, random)
    text = contents.decode()
    for _ in range(random.choice([1, 1, 2])):
        values = [*re.finditer(r"(?<=[:\[,] )[^,:{}\[\]\n]+|(?<=[-\[])[^,:{}\[\]\n]+", text)]
        value = random.choice(values)
        text = text[: value.start()] + random.choice(SCALARS) + text[value.end() :]
    return text.encode()
