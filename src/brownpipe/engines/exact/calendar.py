"""Which event is next: a ring of buckets, without deletion.

A bucket is one cache line: how many entries it has, and up to 15 disks. It holds no times. An entry counts only if
its disk says that it is in this bucket; what a disk was entered for before is left where it is and skipped later. The
bucket that becomes current is poured into a short array sorted by (time, disk), whose last element is the next event.
An event too far ahead for the ring goes into some later bucket, an event whose bucket is full into one before it, and
what is not yet due when its bucket is opened is entered again. Where memory is far, disks wait until their buckets have
come from there, and are put into them before the next bucket is opened.
"""

import numpy as np

from brownpipe.engines.exact.workspace import BUCKET, BUCKET_NOW, EVENT_ROW, ROW, SOON, WAITING
from brownpipe.engines.kernels import kernel, prefetch

LINE, ROOM = 16, 15
OPENED, NOWHERE = 0xFFFFFFFE, 0xFFFFFFFF  # instead of a bucket's number


@kernel
def insert(w, i, time):
    """Enter an event of the current bucket."""
    j = w.progress[SOON]
    w.progress[SOON] = j + 1
    while j > 0 and (w.current_time[j - 1] < time or (w.current_time[j - 1] == time and w.current_disk[j - 1] < i)):
        w.current_time[j] = w.current_time[j - 1]
        w.current_disk[j] = w.current_disk[j - 1]
        j -= 1
    w.current_time[j] = time
    w.current_disk[j] = i
    w.link[ROW * i + BUCKET] = OPENED


@kernel
def push(w, i, time):
    """Enter the next event of disk i; one beyond the end of the block is not entered at all."""
    scale = w.calendar
    if time >= scale.block:
        w.link[ROW * i + BUCKET] = NOWHERE
        return
    now = w.progress[BUCKET_NOW]
    bucket = int(time * scale.per_time)
    if bucket - now > scale.ring:
        bucket = now + scale.ring - (7 * i & (scale.ring >> 1))  # spread: one bucket could not hold them all
    if bucket > now:
        file(w.deferred, w, i, bucket)
    else:
        insert_soon(w, i, time)


@kernel
def file(ahead, w, i, bucket):
    """Put disk i into a bucket; where memory is far, ask for the bucket and put it there before the next is opened."""
    if ahead is None:
        put(w, i, bucket)
        return
    number, n = bucket & w.calendar.ring, w.progress[WAITING]
    prefetch(w.bucket, LINE * number)
    w.link[ROW * i + BUCKET] = number
    ahead.bucket[n], ahead.disk[n] = bucket, i
    w.progress[WAITING] = n + 1
    if n + 1 == len(ahead.disk):
        put_waiting(ahead, w)


@kernel
def put_waiting(ahead, w):
    """Put the disks that wait into their buckets; those that have got another event since would only take room."""
    if ahead is None:
        return
    for j in range(w.progress[WAITING]):
        bucket, i = ahead.bucket[j], np.int64(ahead.disk[j])
        if w.link[ROW * i + BUCKET] == bucket & w.calendar.ring:
            put(w, i, bucket)
    w.progress[WAITING] = 0


@kernel
def put(w, i, bucket):
    """Put disk i into a bucket, or one before it if that is full."""
    now, ring = w.progress[BUCKET_NOW], w.calendar.ring
    while bucket > now:
        line = LINE * (bucket & ring)
        n = w.bucket[line]
        if n < ROOM:
            w.bucket[line] = n + 1
            w.bucket[line + 1 + n] = i
            w.link[ROW * i + BUCKET] = bucket & ring
            return
        bucket -= 1
    insert_soon(w, i, w.event_time[EVENT_ROW * i])


@kernel
def insert_soon(w, i, time):
    """Enter an event of the current bucket, if need be in place of what no longer counts."""
    if w.progress[SOON] == len(w.current_time):
        forget_stale(w)
    insert(w, i, time)


@kernel
def forget_stale(w):
    """Drop the entries of the current bucket that no longer count; what remains is at most one a disk."""
    kept, last_time, last_disk = 0, -1.0, w.current_disk[0]
    for j in range(w.progress[SOON]):
        time, i = w.current_time[j], np.int64(w.current_disk[j])
        if w.event_time[EVENT_ROW * i] == time and not (time == last_time and i == last_disk):
            w.current_time[kept], w.current_disk[kept] = time, i
            kept, last_time, last_disk = kept + 1, time, i
    w.progress[SOON] = kept


@kernel
def open_next_bucket(w):
    """Make the next bucket current."""
    put_waiting(w.deferred, w)
    w.progress[BUCKET_NOW] += 1
    number = w.progress[BUCKET_NOW] & w.calendar.ring
    n = w.bucket[LINE * number]
    w.bucket[LINE * number] = 0
    for j in range(n):
        i = np.int64(w.bucket[LINE * number + 1 + j])
        if w.link[ROW * i + BUCKET] == number:
            push(w, i, w.event_time[EVENT_ROW * i])


@kernel
def next_is_due(w):
    """Whether the next event is known, that is, in the current bucket.

    An event that spilled out of a full bucket can lie beyond the end of the current one, and events of the buckets
    between may come before it.
    """
    soon = w.progress[SOON]
    return soon > 0 and w.current_time[soon - 1] < (w.progress[BUCKET_NOW] + 1) * w.calendar.width


@kernel
def clear(w):
    """Empty the queue and set it to the beginning of a block."""
    w.bucket[::LINE] = 0
    w.progress[BUCKET_NOW] = 0
    w.progress[SOON] = 0
    w.progress[WAITING] = 0
