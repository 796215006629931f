"""Parts that the reports on trajectory files and on datasets share."""

from collections.abc import Mapping

import numpy as np

DIGITS = 12  # of a digest


def worst(values: np.ndarray, seeds: np.ndarray) -> str:
    """Return the largest absolute value (S,) with its seed: `3.8e-16 (seed 31)`; a 0 has no seed, and NaN is largest.

    Without any value return `-`.
    """
    if not values.size:
        return "-"
    sizes = np.abs(values)
    column = int(np.argmax(sizes))
    return f"{sizes[column]:.2g} (seed {seeds[column]})" if sizes[column] else "0"


def provenance(attributes: Mapping[str, str], source_now: str) -> list[str]:
    """Return the versions and the digest of the source that made a file, and whether this installation has the same.

    source_now: digest of this installation's source.
    """
    names = [name for name in attributes if name.endswith("_version")]
    versions = [f"{name.removesuffix('_version')} {attributes[name]}" for name in names]
    digest = attributes.get("source_digest", "unknown")
    source = f"{digest[:DIGITS]}, {'' if digest == source_now else 'not '}that of this installation"
    return [f"written by   {', '.join(versions) or 'unknown'}", f"source       {source}"]
