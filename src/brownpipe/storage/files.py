"""Files that are written completely or not at all, and their seal: the SHA-256 at the end, verified
when one is read.

A checkpoint is such a file: the stored state of a batch of runs, kept beside the output file until
that is complete.

The seal is a last line of text, `# brownpipe-sha256:` and the digest of all bytes before it.
Programs that read HDF5 or YAML do not notice it.
"""

import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from io import BytesIO
from pathlib import Path

import h5py
import numpy as np

from brownpipe.errors import RequestError, StorageError, UnsealedError, WrongFileError

HDF5 = b"\x89HDF\r\n\x1a\n"  # the first bytes of every HDF5 file
SEAL = b"# brownpipe-sha256:"
SEAL_LENGTH = len(SEAL) + 64 + 1  # with the digits of the digest and the end of the line
TRAJECTORIES = "runs_digest"
CHECKPOINT = "checkpoint"
DATASET = "dataset"
SOURCE = "source_digest"  # an attribute of every trajectory file and dataset
KINDS = {  # of HDF5 files, by the attribute that marks them; datasets have none
    TRAJECTORIES: "a trajectory file (of `brownpipe simulate`)",
    CHECKPOINT: (
        "the checkpoint of unfinished runs (repeat the command that wrote it, and they continue)"
    ),
    DATASET: "a dataset (of `brownpipe aggregate`)",
}
UNSEALED = (
    "has lost its seal, the last line, as when another program opens it for writing; whether its "
    "numbers are still those of the runs cannot be verified: put a copy in its place, or move it "
    "away and run the study, or brownpipe {verb}, again; xarray reads it unverified"
)
MALFORMED = (
    ArithmeticError,
    AttributeError,
    LookupError,
    RuntimeError,
    StorageError,
    TypeError,
    ValueError,
)


def write_file(path: str | Path, contents: bytes) -> None:
    """Write a file such that any reader sees the old file or the complete new one.

    The bytes go to a temporary file beside it and are flushed to the disk; then it is renamed
    (`replacing`).

    Raises StorageError if the disk is full or the folder cannot be written to; the temporary file
    is removed.
    """
    write_files({Path(path): contents})


def write_files(files: Mapping[Path, bytes]) -> None:
    """Write files that belong together, as `write_file`; none is replaced before all of them are
    written.
    """
    with ExitStack() as stack:
        for path, contents in files.items():
            temporary = stack.enter_context(replacing(path))
            temporary.write_bytes(contents)


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Yield a temporary file to write to, NAME.brownpipe.part, which then becomes the file at
    `path`; on an error it is removed.

    The folder is created if missing. A temporary file that a killed process has left is overwritten
    by the next writer of the file. Raises StorageError as `write_file` does.
    """
    path = Path(path)
    temporary = path.with_name(f"{path.name}.brownpipe.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        sync(temporary)
        os.replace(temporary, path)
    except OSError as error:
        wrong = f"not written: {error.strerror or error}; free some space, or choose another place"
        raise StorageError(f"{path}: {wrong}") from error
    finally:
        # There may be no such folder, and some file systems cannot wait for one.
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
            sync(path.parent)


def sync(path: Path) -> None:
    """Wait until a file is on the disk or, for a folder, the names of its files."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def write_sealed(path: str | Path, contents: bytes | memoryview) -> None:
    """Write a file as `write_file`, with its seal behind the contents."""
    with replacing(path) as temporary, temporary.open("wb") as file:
        file.writelines([contents, _seal(hashlib.sha256(contents).hexdigest())])


def _seal(digest: str) -> bytes:
    """Return the last line of a file whose contents have this SHA-256."""
    return SEAL + f"{digest}\n".encode()


def seal_of(path: str | Path) -> str:
    """Return the SHA-256 that the seal of a file states, without verifying it; nothing if it does
    not end with one.
    """
    end = np.memmap(path, mode="r")[-SEAL_LENGTH:].tobytes()
    _, _, digest = end.partition(SEAL)
    return digest[:-1].decode("ascii", "replace")


def refuse_foreign(path: str | Path) -> None:
    """Raise RequestError for a file that may not be replaced by a sealed one: it has contents, and
    no seal.
    """
    if os.path.isfile(path) and os.path.getsize(path) and not seal_of(path):
        raise RequestError(
            f"{path}: is no file of brownpipe, or damaged; choose another name for the output"
        )


def verified(path: str | Path) -> str | Path:
    """Return the path of a file after its seal is verified, with some of its bytes at a time in
    memory.

    Raises OSError if it cannot be read and, without the name of the file, UnsealedError if the seal
    alone is lost, StorageError if the file is damaged, WrongFileError if it has neither a seal nor
    the first bytes of HDF5.
    """
    with Path(path).open("rb") as file:
        start = file.read(len(HDF5))
        end = os.fstat(file.fileno()).st_size - SEAL_LENGTH
        digest = hashlib.sha256(start)
        while block := file.read(min(2**20, max(end - file.tell(), 0))):
            digest.update(block)
        seal = file.read()
    if seal != _seal(digest.hexdigest()):
        if has_lost_its_seal(path):
            raise UnsealedError(UNSEALED)
        if not (seal.startswith(SEAL) or HDF5.startswith(start)):
            raise WrongFileError("is no trajectory file or dataset of brownpipe")
        raise StorageError("is damaged, cut short or edited, or no file of brownpipe")
    return path


def has_lost_its_seal(path: str | Path) -> bool:
    """Return whether a file does not end with a seal and is for the rest what brownpipe writes, a
    complete HDF5 file.

    HDF5 cuts off what is behind its own end whenever it opens a file for writing, mode r+ or a,
    even if nothing is written. A file without other bytes missing cannot be told from that.
    """
    if not os.path.getsize(path) or seal_of(path):
        return False
    with suppress(OSError), opened(path) as file:
        return SOURCE in file.attrs  # a checkpoint is soon made again
    return False


@contextmanager
def naming(path: str | Path, verb: str) -> Iterator[None]:
    """Put the file's name before errors of reading it and, if it is damaged, append what to do.

    verb: the verb of brownpipe that makes such files. An intact file that cannot be understood is
    of another version.
    """
    try:
        yield
    except UnsealedError as error:
        raise UnsealedError(f"{path}: {str(error).format(verb=verb)}") from error
    except WrongFileError as error:
        raise WrongFileError(f"{path}: {error}") from error
    except OSError as error:
        raise WrongFileError(f"{path}: cannot be read: {error.strerror or error}") from error
    except MALFORMED as error:
        again = (
            "if a version of brownpipe wrote it, delete it and run the study, or brownpipe "
            f"{verb}, again"
        )
        raise StorageError(f"{path}: {error}; {again}") from error


# -- HDF5 ------------------------------------------------------------------------------------------


@contextmanager
def writing(
    path: str | Path, kind: type[h5py.File] = h5py.File, **options: bool
) -> Iterator[h5py.File]:
    """Yield an HDF5 file in memory, which is then written with its seal; raises StorageError as
    `write_file` does.

    The same groups, datasets and attributes give the same bytes.
    """
    with kind(image := BytesIO(), "w", **options) as file:
        yield file
    write_sealed(path, image.getbuffer())


def opened(path: str | Path) -> h5py.File:
    """Return an HDF5 file, open for reading without locks, which some file systems do not have.

    If the process has it open already, as by `xarray.open_datatree`, HDF5 wants it opened in the
    same way. Raises OSError.
    """
    try:
        return h5py.File(path, locking=False)
    except OSError as error:
        if "file locking" not in str(error):
            raise
        return h5py.File(path)


@contextmanager
def reading(path: str | Path, *kinds: str) -> Iterator[h5py.File]:
    """Yield a file of these KINDS, after its seal is verified.

    Raises StorageError, which names the file and says how to make it again, if it is damaged or of
    another version; WrongFileError if it does not exist or is of another kind.
    """
    verb = "aggregate" if Path(path).suffix == ".nc" else "simulate"
    with naming(path, verb), opened(verified(path)) as file:
        kind = next((kind for kind in KINDS if kind in file.attrs), DATASET)
        if kind not in kinds:
            wanted = " or ".join(map(KINDS.__getitem__, kinds))
            raise WrongFileError(f"is {KINDS[kind]}, not {wanted}")
        yield file


# -- checkpoints -----------------------------------------------------------------------------------


def write_checkpoint(path: str | Path, made_by: dict, arrays: dict[str, np.ndarray]) -> None:
    """Replace a checkpoint file by one with these named arrays.

    `made_by` says which command and source made them: a flat mapping of names to texts and numbers.
    Raises StorageError if the file cannot be written; the earlier file is then still intact.
    """
    with writing(path) as file:
        file.attrs[CHECKPOINT] = json.dumps(made_by)
        file.update(arrays)


def read_checkpoint(path: str | Path, made_by: dict) -> dict[str, np.ndarray] | None:
    """Return the named arrays of a checkpoint file; None if there is no file.

    Raises StorageError if it is damaged, WrongFileError if it is none, RequestError, which names
    the first difference, if its `made_by` differs.
    """
    if not Path(path).exists():
        return None
    with reading(path, CHECKPOINT) as file:
        stored = json.loads(file.attrs[CHECKPOINT])
        arrays = {name: item[()] for name, item in file.items()}
    for name, value in made_by.items():
        if stored.get(name) != value:
            cure = "repeat that command, delete this file to begin anew, or choose another --output"
            raise RequestError(
                f"{path}: is of a run with {name} {stored.get(name)!s:.40}, not {value!s:.40}; "
                f"{cure}"
            )
    return arrays


def remove_checkpoint(path: str | Path) -> None:
    """Remove a checkpoint file, and the temporary file of one that a killed process has left."""
    for file in (path, f"{path}.brownpipe.part"):
        Path(file).unlink(missing_ok=True)
