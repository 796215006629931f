"""All results that are reproduced, in the order of docs/validation.md.

To add one: scenes and study in `config/validation/`, `NAME_large.yaml` if it is too long for `make
validation`; `validation/NAME.py` with published numbers and their source, read there by somebody,
`compare`, `draw`, and `RESULT` with a version of some 2 s for the tests; a section of the page with
two comments, between which
`python -m validation NAME` writes the table. Its `remark` explains a difference of more than three
standard errors.
"""

from validation import (
    brownian_limit,
    cages,
    channels,
    contact,
    equation_of_state,
    hexatic_order,
    long_time_tail,
    self_diffusion,
    virial,
    walls,
)

RESULTS = {
    module.RESULT.name: module.RESULT
    for module in (
        virial,
        equation_of_state,
        contact,
        self_diffusion,
        long_time_tail,
        brownian_limit,
        walls,
        channels,
        cages,
        hexatic_order,
    )
}
