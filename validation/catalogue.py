"""All results that are reproduced, in the order of docs/validation.md."""

from validation import (
    brownian_limit,
    cages,
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
        cages,
        hexatic_order,
    )
}
