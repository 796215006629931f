"""Brownian motion from first principles: hard disks that collide exactly, a heavy one among them
that wanders.

    import brownpipe as bp
    runs = bp.simulate("scene.yaml", seeds=200)
    result = bp.analyse(runs)
    bp.plot(result, "msd")

`interface` describes these functions. It is imported with the first of them, so that `import
brownpipe` takes no time.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from brownpipe.engines.definition import Definition
    from brownpipe.errors import (
        AnalysisError,
        BrownpipeError,
        FigureError,
        RequestError,
        RunError,
        StorageError,
    )
    from brownpipe.interface import (
        Columns,
        Configuration,
        Estimator,
        Figure,
        Scene,
        Variable,
        analyse,
        mean,
        open,
        path,
        plot,
        read_configuration,
        read_scene,
        replay,
        run,
        save,
        scan,
        simulate,
        table,
    )

__all__ = [
    "AnalysisError",
    "BrownpipeError",
    "FigureError",
    "RequestError",
    "RunError",
    "StorageError",
]
__all__ += [
    "Columns",
    "Configuration",
    "Definition",
    "Estimator",
    "Figure",
    "Scene",
    "Variable",
    "analyse",
    "mean",
    "open",
    "path",
    "plot",
    "read_configuration",
    "read_scene",
    "replay",
    "run",
    "save",
    "scan",
    "simulate",
    "table",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version(__name__)
    if name not in __all__:
        raise AttributeError(f"module 'brownpipe' has no attribute {name!r}")
    from importlib import import_module

    module = "brownpipe.errors" if name.endswith("Error") else "brownpipe.interface"
    return getattr(import_module(module), name)


def __dir__() -> list[str]:
    return sorted({*(name for name in globals() if name.startswith("_")), "__version__", *__all__})
