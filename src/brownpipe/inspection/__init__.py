"""What is in a file, and whether its runs can be reproduced to the bit: `brownpipe inspect`.

The reports show numbers as figures and summary do, and runs are made by the engines: this layer is
above both. It is not part of `figures` or `storage`, because a change of a report must not run any
step of a study again.
"""

from brownpipe.inspection.reports import (
    describe_product,
    file_report,
    scene_text,
    table_of_variables,
)

__all__ = ["describe_product", "file_report", "scene_text", "table_of_variables"]
