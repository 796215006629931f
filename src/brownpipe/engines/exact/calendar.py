"""The event queue: a calendar queue with lazy deletion.

A calendar queue (R. Brown, Commun. ACM 31, 1220 (1988); in event-driven molecular dynamics G. Paul,
J. Comput. Phys. 221, 615 (2007)) divides time into buckets of equal duration, which form a ring;
only the current bucket is sorted. Here a bucket is one cache line: a count and up to 15 disks,
without times. Lazy deletion: an entry is valid only if the disk's BUCKET field points here;
outdated entries stay and are skipped when the bucket is opened. The events of the current bucket
are in an array sorted by (time, disk), whose last element is the next event.

An event beyond the end of the ring is stored in an earlier bucket, and so is an event whose bucket
is full. When that bucket is opened, events that are not yet due are pushed again. With many disks
an insertion is deferred until the bucket has been prefetched: until the next bucket but one is
opened.

`push` enters an event into the queue, `store` into a future bucket, `insert_event` into the current
one.
"""

import numpy as np

from brownpipe.engines.compiled.kernels import entry_point, kernel, prefetch
from brownpipe.engines.compiled.records import local_copy
from brownpipe.engines.exact import workspace as ws

# uint32 words of a bucket, one cache line; disks that it can hold
BUCKET_WORDS, CAPACITY = 16, 15
MOST_DEFERRED = 64  # insertions deferred during one bucket at most: more than its events schedule
# in place of a bucket's number in the BUCKET field
IN_CURRENT, BEYOND_BLOCK = 0xFFFFFFFE, 0xFFFFFFFF


@kernel
def push(w: ws.Workspace, i: int, time: float) -> None:
    """Enter the next event of disk i, unless it lies beyond the end of the block: the next block
    predicts it anew.
    """
    scale = w.calendar
    if time >= scale.block:
        w.link[ws.ROW * i + ws.BUCKET] = BEYOND_BLOCK
        return
    current = w.progress[ws.CURRENT_BUCKET]
    bucket = int(time * scale.per_time)
    if bucket - current > scale.ring:
        # spread: one bucket could not hold them all
        bucket = current + scale.ring - (7 * i & (scale.ring >> 1))
    if bucket > current:
        store_or_defer(w.deferred, w, i, bucket)
    else:
        insert_event(w, i, time)


@kernel
def store_or_defer(deferred: ws.Deferred | None, w: ws.Workspace, i: int, bucket: int) -> None:
    """Store disk i in a future bucket; with many disks, prefetch the bucket and defer the
    insertion.

    An event in the next bucket is stored at once: that bucket has been prefetched, and a deferred
    insertion would come too late.
    """
    current = w.progress[ws.CURRENT_BUCKET]
    if deferred is None or bucket == current + 1:
        store(w, i, bucket)
        return
    number, parity = bucket & w.calendar.ring, current & 1
    prefetch(w.bucket, BUCKET_WORDS * number)
    w.link[ws.ROW * i + ws.BUCKET] = number
    n = deferred.number[parity]
    deferred.bucket[MOST_DEFERRED * parity + n] = bucket
    deferred.disk[MOST_DEFERRED * parity + n] = i
    deferred.number[parity] = n + 1
    if n + 1 == MOST_DEFERRED:
        store_deferred(deferred, w, parity)


@kernel
def store_deferred(deferred: ws.Deferred | None, w: ws.Workspace, parity: int) -> None:
    """Carry out the insertions that were deferred while a bucket of this parity (even: 0, odd: 1)
    was the current one.

    Those of disks whose event has been predicted anew since are left out.
    """
    if deferred is None:
        return
    first = MOST_DEFERRED * parity
    for j in range(first, first + deferred.number[parity]):
        bucket, i = deferred.bucket[j], np.int64(deferred.disk[j])
        if w.link[ws.ROW * i + ws.BUCKET] == bucket & w.calendar.ring:
            store(w, i, bucket)
    deferred.number[parity] = 0


@kernel
def store(w: ws.Workspace, i: int, bucket: int) -> None:
    """Store disk i in a future bucket, or in the nearest bucket before it that is not full."""
    current, ring = w.progress[ws.CURRENT_BUCKET], w.calendar.ring
    while bucket > current:
        first = BUCKET_WORDS * (bucket & ring)
        n = w.bucket[first]
        if n < CAPACITY:
            w.bucket[first] = n + 1
            w.bucket[first + 1 + n] = i
            w.link[ws.ROW * i + ws.BUCKET] = bucket & ring
            return
        bucket -= 1
    insert_event(w, i, w.event_time[ws.EVENT_ROW * i])


@kernel
def insert_event(w: ws.Workspace, i: int, time: float) -> None:
    """Insert an event into the sorted array of the current bucket."""
    if w.progress[ws.CURRENT_EVENTS] == len(w.current_time):
        remove_outdated(w)
    j = w.progress[ws.CURRENT_EVENTS]
    w.progress[ws.CURRENT_EVENTS] = j + 1
    while j > 0 and (
        w.current_time[j - 1] < time
        or (w.current_time[j - 1] == time and w.current_disk[j - 1] < i)
    ):
        w.current_time[j] = w.current_time[j - 1]
        w.current_disk[j] = w.current_disk[j - 1]
        j -= 1
    w.current_time[j] = time
    w.current_disk[j] = i
    w.link[ws.ROW * i + ws.BUCKET] = IN_CURRENT


@kernel
def remove_outdated(w: ws.Workspace) -> None:
    """Remove outdated and repeated entries from the current bucket; at most one entry per disk
    remains.
    """
    n, last_time, last_disk = 0, -1.0, w.current_disk[0]
    for j in range(w.progress[ws.CURRENT_EVENTS]):
        time, i = w.current_time[j], np.int64(w.current_disk[j])
        if w.event_time[ws.EVENT_ROW * i] == time and not (time == last_time and i == last_disk):
            w.current_time[n], w.current_disk[n] = time, i
            last_time, last_disk = time, i
            n += 1
    w.progress[ws.CURRENT_EVENTS] = n


@kernel
def bucket_after(w: ws.Workspace, n: int) -> int:
    """Return the ring index of the bucket n after the current one."""
    return (w.progress[ws.CURRENT_BUCKET] + n) & w.calendar.ring


@kernel
def entry_after(w: ws.Workspace, n: int, e: int) -> np.int64:
    """Return entry e, from 0, of the bucket n after the current one: a disk."""
    return np.int64(w.bucket[BUCKET_WORDS * bucket_after(w, n) + 1 + e])


@kernel
def entries_after(w: ws.Workspace, n: int) -> np.int64:
    """Return how many entries, valid or outdated, the bucket n after the current one has."""
    return np.int64(w.bucket[BUCKET_WORDS * bucket_after(w, n)])


@kernel
def bucket_entries(w: ws.Workspace, number: int) -> range:
    """Return the range of indices in `w.bucket` at which a bucket's disks are, valid or
    outdated.
    """
    first = BUCKET_WORDS * number
    return range(first + 1, first + 1 + w.bucket[first])


@kernel
def keep_valid(w: ws.Workspace, number: int) -> None:
    """Remove the outdated entries of a bucket."""
    first, n = BUCKET_WORDS * number + 1, 0
    for j in bucket_entries(w, number):
        i = np.int64(w.bucket[j])
        w.bucket[first + n] = i
        n += w.link[ws.ROW * i + ws.BUCKET] == number  # a branch would be mispredicted often
    w.bucket[first - 1] = n


@kernel
def open_next_bucket(w: ws.Workspace) -> None:
    """Make the next bucket the current one.

    A disk that was entered twice is pushed twice: `run_until` finds the second entry outdated.
    """
    number = w.progress[ws.CURRENT_BUCKET] + 1
    store_deferred(w.deferred, w, number & 1)
    w.progress[ws.CURRENT_BUCKET] = number
    opened = number & w.calendar.ring
    keep_valid(w, opened)
    valid = bucket_entries(w, opened)
    w.bucket[BUCKET_WORDS * opened] = 0
    for j in valid:
        i = np.int64(w.bucket[j])
        push(w, i, w.event_time[ws.EVENT_ROW * i])


@kernel
def has_next_event(w: ws.Workspace) -> bool:
    """Whether the last element of the current bucket is the next event of all.

    An event that was moved here from a later, full bucket lies beyond the end of the current one;
    events in the buckets between may precede it.
    """
    n = w.progress[ws.CURRENT_EVENTS]
    return n > 0 and w.current_time[n - 1] < (w.progress[ws.CURRENT_BUCKET] + 1) * w.calendar.width


@kernel
def empty_queue(deferred: ws.Deferred | None, w: ws.Workspace) -> None:
    """Empty the queue, and set it to the beginning of a block."""
    w.bucket[::BUCKET_WORDS] = 0
    w.progress[ws.CURRENT_BUCKET] = 0
    w.progress[ws.CURRENT_EVENTS] = 0
    if deferred is not None:
        deferred.number[:] = 0


@entry_point
def push_all(w: ws.Workspace) -> None:
    """Enter the next events of all disks again: buckets have another duration now."""
    w = local_copy(w)
    empty_queue(w.deferred, w)
    w.progress[ws.CURRENT_BUCKET] = int(w.tally[ws.NOW] * w.calendar.per_time)
    for i in range(len(w.disk) // ws.ROW - 1, -1, -1):
        push(w, i, w.event_time[ws.EVENT_ROW * i])
