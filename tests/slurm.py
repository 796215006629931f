"""A Slurm cluster of one node, this machine. It is up in some seconds, has no accounting database, and is thrown away.

It needs Debian's packages slurm-wlm and munge, and root: Slurm's commands look for their configuration in one place.

    python3 tests/slurm.py      install the packages if need be; if there can be no cluster here, say why and end by 1
"""

import fcntl
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager, suppress
from pathlib import Path

CONFIGURATION = Path("/etc/slurm/slurm.conf")  # where Slurm's commands look for it
OURS = "# A cluster for tests of brownpipe: while none of them runs, this file can be removed.\n"
PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "squeue", "scontrol", "scancel", "sinfo", "srun", "setpriv")
SEARCHED = f"{os.environ['PATH']}:/usr/sbin:/sbin"  # folders of programs
PATIENCE = 60  # seconds for what takes one on an idle machine
MEMORY = 4000  # MB of the node; jobs that ask for less run at the same time

# `MinJobAge`: seconds for which `squeue --states=all` shows a job that has ended. `linuxproc` follows processes by
# their parents, without control groups, which a container may lack. `cred_expire`: seconds until a job that was put
# back into the queue is started again, by default 120. `EnforcePartLimits`: a job that could never start is refused.
# `OverMemoryKill`: a job that has more memory than it asked for is killed; this is looked at every second.
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
def cluster(folder):
    """A running cluster with its state and logs in a folder; at the end its jobs and processes are ended.

    Raises BlockingIOError if another process has one here: the configuration is locked as long as it is used.
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
    host, cpus = socket.gethostname().partition(".")[0], os.cpu_count()
    controller, node = free_ports(2)
    values = {"host": host, "cpus": cpus, "memory": MEMORY, "controller": controller, "node": node, "folder": folder}
    configuration.truncate(0)
    configuration.write(OURS + TEXT.format(**values))
    configuration.flush()


def start_daemons(folder, daemons):
    """Start the daemons of a cluster, append each to a list, and wait until the node takes jobs."""
    key, sock = folder / "munge.key", folder / "munge.socket"
    key.write_bytes(os.urandom(128))
    key.chmod(0o400)
    private = [f"--{name}-file={folder}/munge.{name}" for name in ("key", "pid", "seed", "log")]
    daemons.append(start(["munged", "--foreground", "--force", f"--socket={sock}", *private], folder))
    wait_until(sock.exists, daemons)
    daemons.append(start(["slurmctld", "-D"], folder))
    daemons.append(start(["slurmd", "-D"], folder))
    wait_until(lambda: "idle" in said("sinfo", "--noheader", "--format=%T"), daemons)


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
        return subprocess.Popen(words, env=environment, stdin=subprocess.DEVNULL, stdout=log, stderr=log)


def cancel_all():
    """Kill all jobs, and wait until they are gone."""
    said("scancel", "--signal=KILL", "--full", f"--user={os.geteuid()}")
    said("scancel", f"--user={os.geteuid()}")
    wait_until(lambda: not jobs("PENDING,RUNNING,COMPLETING"), patience=10)


def jobs(states):
    """The numbers of the jobs in one of these states, oldest first."""
    return sorted(map(int, said("squeue", "--noheader", "--format=%i", f"--states={states}").split()))


def wait_until(holds, daemons=(), patience=PATIENCE):
    """Wait until a condition holds, for as long as the daemons run."""
    end = time.monotonic() + patience
    while not holds():
        assert all(daemon.poll() is None for daemon in daemons), f"{[daemon.args for daemon in daemons]} ended"
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.1)


def said(*command):
    """What a command of Slurm prints."""
    return subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False).stdout


def install():
    """Install the packages, if they are missing and this user may."""
    if any(found(name) is None for name in PROGRAMS) and os.geteuid() == 0 and shutil.which("apt-get"):
        script = "apt-get update && apt-get install -y --no-install-recommends slurm-wlm munge"
        environment = os.environ | {"DEBIAN_FRONTEND": "noninteractive"}
        with suppress(subprocess.TimeoutExpired):
            subprocess.run(["sh", "-c", script], env=environment, capture_output=True, timeout=180, check=False)


def failure():
    """Start a cluster and stop it; return why that failed, in one line, or None."""
    try:
        with tempfile.TemporaryDirectory() as folder, cluster(Path(folder)):
            return None
    except (AssertionError, OSError, subprocess.SubprocessError) as error:
        return f"the cluster does not start: {error}"


if __name__ == "__main__":
    install()
    if why := lacking() or failure():
        print(why)
    sys.exit(why is not None)
