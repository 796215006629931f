"""What a figure, table, summary, page or movie says it was made from."""

from pathlib import Path

from brownpipe.errors import WrongFileError
from brownpipe.figures.origin import RECORD, installation_in_words, read_record
from brownpipe.inspection.lines import DIGITS

SUFFIXES = (".png", ".svg", ".csv", ".txt", ".json", ".gif", ".html")  # of what `brownpipe figures` and `movie` write


def describe_product(path: str | Path) -> list[str]:
    """Return lines that say what made a product, and by which commands its runs are made again.

    Raises WrongFileError for a file that does not say what it was made from, or that cannot be read.
    """
    try:
        record = read_record(path)
    except OSError as error:
        raise WrongFileError(f"{path}: cannot be read: {error.strerror}") from error
    if record is None:
        raise WrongFileError(f"{path}: does not say what it was made from, and no {RECORD} beside it does")
    dataset = record.get("dataset", {})
    lines = [f"{path}  made by {installation_in_words(record['made_by'])}"]
    lines += [f"dataset      {dataset['sha256'][:DIGITS]}"] if dataset else []
    runs = [*dataset.get("made_from", []), *record.get("made_from", [])]
    return lines + [f"runs         {one['command']}" for one in runs]
