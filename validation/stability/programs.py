"""The programs that are compared, by the names of their columns; pymunk is apart, as it moves in
time steps.
"""

from collections.abc import Callable, Mapping

from validation.stability.note_loop import note_loop
from validation.stability.outcome import Outcome, brownpipe
from validation.stability.plain import plain
from validation.stability.start import Start

Run = Callable[[Start, float], Outcome]
# None where the program is not installed, or would take too long
Attempt = Callable[[Start, float], Outcome | None]
OTHERS: Mapping[str, Run] = {"note's loop": note_loop, "plain event-driven": plain}
EVENT_DRIVEN: Mapping[str, Run] = {"brownpipe": brownpipe, **OTHERS}
GAME = "pymunk"
COLUMNS = (*EVENT_DRIVEN, GAME)
