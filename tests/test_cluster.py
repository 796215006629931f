"""A study on a Slurm cluster of one node, by the profile `slurm`: make cluster-test, or pytest with
--cluster.

The cluster is this machine. It is up in some seconds, has no accounting database, and is thrown
away. It needs Debian's packages slurm-wlm and munge, and root: Slurm's commands look for their
configuration in one place.
"""

import fcntl
import hashlib
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

pytestmark = pytest.mark.cluster
STUDY = Path(__file__).parent.parent / "config" / "small.yaml"
POLLED = [
    "--",
    "--slurm-init-seconds-before-status-checks",
    "1",
]  # seconds between two looks at the queue, not 20
LONGEST = 300  # seconds for a study that takes 50 on two idle cores
CONFIGURATION = Path("/etc/slurm/slurm.conf")  # where Slurm's commands look for it
OURS = "# A cluster for tests of brownpipe: while none of them runs, this file can be removed.\n"
PROGRAMS = (
    "munged",
    "slurmctld",
    "slurmd",
    "sbatch",
    "squeue",
    "scontrol",
    "scancel",
    "sinfo",
    "srun",
    "setpriv",
)
SEARCHED = f"{os.environ['PATH']}:/usr/sbin:/sbin"  # folders of programs
PATIENCE = 60  # seconds for what takes one on an idle machine
MEMORY = 4000  # MB of the node; jobs that ask for less run at the same time

# `MinJobAge`: seconds for which `squeue --states=all` shows a job that has ended. `linuxproc`
# follows processes by their parents, without control groups, which a container may lack.
# `cred_expire`: seconds until a job that was put back into the queue is started again, by default
# 120. `EnforcePartLimits`: a job that could never start is refused. `OverMemoryKill`: a job that
# has more memory than it asked for is killed; this is looked at every second.
TEXT = """\
ClusterName=brownpipe
SlurmctldHost={host}
SlurmUser=root
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket,cred_expire=10
SlurmctldPort={controller}
SlurmdPort={node}
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
MpiDefault=none
SchedulerType=sched/builtin
SchedulerParameters=batch_sched_delay=0,sched_interval=1
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
AccountingStorageType=accounting_storage/none
JobAcctGatherType=jobacct_gather/linux
JobAcctGatherFrequency=task=1
JobAcctGatherParams=OverMemoryKill
MinJobAge=3600
EnforcePartLimits=ALL
ReturnToService=2
KillWait=2
NodeName={host} NodeAddr=127.0.0.1 CPUs={cpus} RealMemory={memory}
PartitionName=short Nodes={host} Default=YES MaxTime=180
"""


def lacking():
    """Return why no cluster can be started here, in one line; None if one can."""
    missing = [name for name in PROGRAMS if found(name) is None]
    if missing:
        return f"there is no {', '.join(missing)} (Debian: apt install slurm-wlm munge)"
    if os.cpu_count() < 2:
        return "two jobs cannot run at the same time on one core"
    if os.geteuid() != 0:
        return "only root can write Slurm's configuration"
    if CONFIGURATION.exists() and not CONFIGURATION.read_text(errors="replace").startswith(OURS):
        return f"{CONFIGURATION} is that of another cluster"
    return None


def found(program):
    """The path of a program, or None."""
    return shutil.which(program, path=SEARCHED)


@contextmanager
def slurm_cluster(folder):
    """A running cluster with its state and logs in a folder; at the end its jobs and processes are
    ended.

    Raises BlockingIOError if another process has one here: the configuration is locked as long as
    it is used.
    """
    for name in ("state", "spool"):
        (folder / name).mkdir()
    folder.chmod(0o755)
    daemons = []
    with open(CONFIGURATION, "a+") as configuration:
        fcntl.flock(configuration, fcntl.LOCK_EX | fcntl.LOCK_NB)
        try:
            write_configuration(configuration, folder)
            start_daemons(folder, daemons)
            yield
        finally:
            with suppress(subprocess.SubprocessError, AssertionError):
                cancel_all()
            stop(daemons)
            CONFIGURATION.unlink()


def write_configuration(configuration, folder):
    """Write the configuration of a cluster whose files are in a folder to an open file."""
    host = socket.gethostname().partition(".")[0]
    cpus = os.cpu_count()
    controller, node = free_ports(2)
    values = {
        "host": host,
        "cpus": cpus,
        "memory": MEMORY,
        "controller": controller,
        "node": node,
        "folder": folder,
    }
    configuration.truncate(0)
    configuration.write(OURS + TEXT.format(**values))
    configuration.flush()


def start_daemons(folder, daemons):
    """Start the daemons of a cluster, append each to a list, and wait until the node takes jobs."""
    key = folder / "munge.key"
    sock = folder / "munge.socket"
    key.write_bytes(os.urandom(128))
    key.chmod(0o400)
    private = [f"--{name}-file={folder}/munge.{name}" for name in ("key", "pid", "seed", "log")]
    daemons.append(
        start(["munged", "--foreground", "--force", f"--socket={sock}", *private], folder)
    )
    wait_until(sock.exists, daemons)
    daemons.append(start(["slurmctld", "-D"], folder))
    daemons.append(start(["slurmd", "-D"], folder))
    wait_until(lambda: "idle" in printed("sinfo", "--noheader", "--format=%T"), daemons)


def stop(daemons):
    """End the daemons, the last first."""
    for daemon in reversed(daemons):
        daemon.terminate()
        try:
            daemon.wait(10)
        except subprocess.TimeoutExpired:
            daemon.kill()
            daemon.wait()


def free_ports(count):
    """TCP ports that nobody uses now."""
    sockets = [socket.socket() for _ in range(count)]
    for one in sockets:
        one.bind(("127.0.0.1", 0))
    ports = [one.getsockname()[1] for one in sockets]
    for one in sockets:
        one.close()
    return ports


def start(command, folder):
    """Start a daemon with a log in a folder. It ends with this process, however that ends."""
    environment = os.environ | {"PATH": SEARCHED}
    with open(folder / f"{command[0]}.log", "wb") as log:
        words = ["setpriv", "--pdeathsig", "TERM", *command]
        return subprocess.Popen(
            words, env=environment, stdin=subprocess.DEVNULL, stdout=log, stderr=log
        )


def cancel_all():
    """Kill all jobs, and wait until they are gone."""
    printed("scancel", "--signal=KILL", "--full", f"--user={os.geteuid()}")
    printed("scancel", f"--user={os.geteuid()}")
    wait_until(lambda: not jobs("PENDING,RUNNING,COMPLETING"), patience=10)


def jobs(states):
    """The numbers of the jobs in one of these states, oldest first."""
    return sorted(
        map(int, printed("squeue", "--noheader", "--format=%i", f"--states={states}").split())
    )


def wait_until(holds, daemons=(), patience=PATIENCE):
    """Wait until a condition holds, for as long as the daemons run."""
    end = time.monotonic() + patience
    while not holds():
        assert all(daemon.poll() is None for daemon in daemons), (
            f"{[daemon.args for daemon in daemons]} ended"
        )
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.1)


def printed(*command):
    """What a command of Slurm prints."""
    return subprocess.run(
        command, capture_output=True, text=True, timeout=PATIENCE, check=False
    ).stdout


# -- the study ---


def study(folder, *further):
    """The start of a study in a folder."""
    folder.mkdir()
    command = [sys.executable, "-m", "brownpipe", "run", str(STUDY), *further]
    with open(folder / "screen", "w") as screen:
        return subprocess.Popen(
            command, cwd=folder, stdout=screen, stderr=screen, start_new_session=True
        )


def digests(folder):
    """The SHA-256 of all results by their path, without logs."""
    results = folder / "results"
    files = {
        path.relative_to(results): path
        for path in results.rglob("*")
        if path.is_file() and path.suffix != ".log"
    }
    return {
        str(name): hashlib.sha256(path.read_bytes()).hexdigest() for name, path in files.items()
    }


def hit(running, effect, *command):
    """Give running jobs, the last first, to a command of Slurm until one of them shows the effect:
    some end before.
    """

    def works():
        for job in map(str, reversed(jobs("RUNNING"))):
            printed(*command, job)
            for _ in range(20):
                if effect in (shown := printed("scontrol", "show", "job", job)):
                    return True
                if "JobState=COMPLETED" in shown:
                    break
                time.sleep(0.1)
        return False

    wait_until(works, [running], LONGEST)


@pytest.fixture(scope="module", autouse=True)
def cluster(tmp_path_factory):
    if why := lacking():
        pytest.fail(f"no cluster: {why}")
    folder = tmp_path_factory.mktemp("slurm") / "cluster"
    folder.mkdir()
    with slurm_cluster(folder):
        yield


def test_a_study_has_the_same_bytes_as_on_one_machine_though_jobs_were_killed_and_requeued(
    tmp_path,
):
    """In a folder whose name a shell would take apart."""
    folder = tmp_path / "a $HOME of studies"
    running = study(folder, "--profile", "slurm", *POLLED)
    try:
        wait_until(
            lambda: len(jobs("RUNNING")) > 1, [running], LONGEST
        )  # one job compiles the kernels
        hit(running, "JobState=CANCELLED", "scancel", "--signal=KILL", "--full")
        hit(running, "Restarts=1", "scontrol", "requeue")
        status = running.wait(LONGEST)
    finally:
        with suppress(ProcessLookupError):
            os.killpg(running.pid, signal.SIGKILL)  # also Snakemake, which would wait for its jobs
        running.wait()
    screen = (folder / "screen").read_text()
    assert status == 0, screen
    assert "MSD(t = " in screen, "the answer is printed here, not on the node"
    assert study(tmp_path / "local").wait(LONGEST) == 0
    assert len(digests(folder)) > 25
    assert digests(folder) == digests(tmp_path / "local")
