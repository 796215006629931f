"""Files that a user names: wrong paths and files, links, permissions, writers that are killed."""

import os
import signal
import time

import pytest

import brownpipe
from brownpipe.errors import BrownpipeError
from brownpipe.storage.datasets import read_dataset
from brownpipe.storage.files import write_file
from brownpipe.storage.trajectories import read_trajectories
from brownpipe.study import read_study

LONGEST = 300  # characters of a message, besides the path


def test_paths_that_no_system_allows(tmp_path):
    for path in (str(tmp_path / ("x" * 5000)), str(tmp_path)):
        for read in (brownpipe.read_scene, read_trajectories, read_dataset, brownpipe.open):
            with pytest.raises(BrownpipeError, match="cannot be read") as caught:
                read(path)
            assert len(str(caught.value)) <= LONGEST + len(path)


def test_a_wrong_file_is_not_shown(tmp_path):
    """The text of a file that is no scene or study may be a secret."""
    path = tmp_path / "passwd.yaml"
    path.write_text("root:x:0:0:secret:/root:/bin/bash\ndaemon:x:1:1:secret:/usr/sbin\n")
    for read in (brownpipe.read_scene, read_study):
        with pytest.raises(BrownpipeError) as caught:
            read(path)
        assert "secret" not in str(caught.value) and str(caught.value).endswith("not a text")


def test_a_link_in_place_of_a_file_is_replaced_and_a_linked_folder_is_used(tmp_path):
    (tmp_path / "precious").write_bytes(b"mine")
    (tmp_path / "x").symlink_to("precious")
    (tmp_path / "scratch").mkdir()
    (tmp_path / "results").symlink_to("scratch")
    write_file(tmp_path / "x", b"new")
    write_file(tmp_path / "results" / "y", b"new")
    assert (tmp_path / "precious").read_bytes() == b"mine" and not (tmp_path / "x").is_symlink()
    assert (tmp_path / "scratch" / "y").read_bytes() == b"new" and (tmp_path / "results").is_symlink()


@pytest.mark.parametrize("mask", [0o022, 0o077, 0o002])
def test_files_have_the_usual_permissions(mask, tmp_path):
    before = os.umask(mask)
    try:
        write_file(tmp_path / "x", b"")
    finally:
        os.umask(before)
    assert (tmp_path / "x").stat().st_mode & 0o777 == 0o666 & ~mask


@pytest.mark.slow
def test_killed_writers_leave_the_old_file_and_the_next_one_no_litter(faults, tmp_path):
    contents = [bytes([k]) * 300_000 for k in range(2)]
    write_file(tmp_path / "x", contents[0])
    left = 0
    for _ in faults.tries(20):
        child = os.fork()
        if child == 0:
            while True:
                for each in contents:
                    write_file(tmp_path / "x", each)
        time.sleep(faults.random.uniform(0.0, 0.02))
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        left += len([*tmp_path.glob("*.part")])
        assert (tmp_path / "x").read_bytes() in contents
        write_file(tmp_path / "x", contents[0])
        assert os.listdir(tmp_path) == ["x"]
    print(f"parts left by killed writers: {left}")
