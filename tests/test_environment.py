"""./in-env and environment/root-filesystem, with the tools that they call replaced by small fakes.

Nothing is downloaded: the fakes record their calls, and PATH has nothing but them and a few
basic commands.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parent.parent
BASIC = (
    "bash basename cat chown cut dirname du echo env flock mkdir mv readlink realpath rm sed sh"
    " sha256sum sleep sync touch true uname"
)

pytestmark = [
    pytest.mark.serial,
    pytest.mark.skipif(
        any(shutil.which(name) is None for name in BASIC.split()), reason="for Linux systems"
    ),
]

# The last argument but a mirror is the folder to fill.  A shell waits for its sleep to end before
# it heeds SIGINT, unless it is told otherwise and the sleep is in the background.
MMDEBSTRAP = """
trap 'trap - INT; kill -INT $$' INT
for folder; do :; done
mkdir -p "$folder/usr/bin" "$folder/etc"
echo "mmdebstrap fills $folder" >>"$LOG"
sleep "${FAKE_SECONDS:-0}" </dev/null >/dev/null 2>&1 &
wait $!
exit "${FAKE_EXIT:-0}"
"""
# The real one ends its options where the command begins: here at the first of these.
BWRAP = """
echo "bwrap $*" >>"$LOG"
while [ $# -gt 0 ]; do
    case $1 in
        setpriv) shift 3 && exec "$@" ;;
        true | python3) exit 0 ;;
    esac
    shift
done
"""
UNSHARE = """
while [ "${1#--}" != "$1" ]; do shift; done
exec "$@"
"""


class Host:
    """A make-believe machine: a PATH, a HOME and a log of what was called."""

    def __init__(self, folder: Path, user: int = 1000) -> None:
        self.bin = folder / "bin"
        self.log = folder / "log"
        self.cache = folder / "home" / ".cache" / "contact-locking"
        self.bin.mkdir()
        self.log.touch()
        for name in BASIC.split():
            (self.bin / name).symlink_to(str(shutil.which(name)))
        self.add("id", f"[ $1 = -u ] && echo {user} || echo someone")
        self.add("python3", "exit 1")
        self.environment = {
            "PATH": str(self.bin),
            "HOME": str(folder / "home"),
            "LOG": str(self.log),
        }

    def add(self, name: str, script: str) -> None:
        (self.bin / name).write_text("#!/bin/sh\n" + script)
        (self.bin / name).chmod(0o755)

    def add_tools(self) -> None:
        self.add("mmdebstrap", MMDEBSTRAP)
        self.add("bwrap", BWRAP)
        self.add_unshare()
        self.add("newuidmap", "")

    def add_unshare(self) -> None:
        self.add("setpriv", 'shift 2; exec "$@"')
        self.add("unshare", UNSHARE)

    def start(self, *command: str, **settings: str) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [str(CHECKOUT / "in-env"), *command],
            env=self.environment | settings,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    def run(self, *command: str, **settings: str) -> tuple[int, str, str]:
        process = self.start(*command, **settings)
        out, err = process.communicate(timeout=30)
        return process.returncode, out, err

    def environments(self) -> list[str]:
        """The names of what is in the cache, but for the lock."""
        return sorted(set(os.listdir(self.cache)) - {"lock"}) if self.cache.is_dir() else []


@pytest.fixture
def host(tmp_path: Path) -> Host:
    return Host(tmp_path)


@pytest.fixture
def equipped(host: Host) -> Host:
    host.add_tools()
    return host


def test_a_python_with_dolfinx_is_used_as_it_is(host: Host) -> None:
    host.add("python3", '[ "${1##*/}" = check_python.py ] || echo "$PYTHONPATH $OMP_NUM_THREADS"')
    assert host.run("python3") == (0, f"{CHECKOUT} 1\n", "")


def test_the_exit_code_is_the_commands(host: Host, tmp_path: Path) -> None:
    host.add("python3", "exit 0")
    assert host.run("sh", "-c", "exit 7")[0] == 7
    host.add("python3", "exit 1")
    host.add_tools()
    assert host.run("sh", "-c", "exit 7")[0] == 7


def test_missing_tools_are_named_with_the_command_that_installs_them(host: Host) -> None:
    host.add("apt-get", 'echo "apt-get $*" >>"$LOG"')
    code, out, err = host.run("true")
    assert (code, out) == (1, "")
    assert "sudo apt-get install bubblewrap mmdebstrap uidmap\n" in err
    assert host.log.read_text() == ""
    assert host.environments() == []


def test_the_environment_is_announced_and_built_once(equipped: Host) -> None:
    code, out, err = equipped.run("echo", "solved")
    assert (code, out) == (0, "solved\n")
    assert "3 GB" in err
    assert equipped.run("echo", "again") == (0, "again\n", "")
    assert equipped.log.read_text().count("mmdebstrap fills") == 1
    (name,) = equipped.environments()
    assert name.startswith("trixie-")


@pytest.mark.parametrize("name", ["debian-packages.txt", "debian-development-packages.txt"])
def test_another_package_list_or_suite_is_another_environment(
    equipped: Host, tmp_path: Path, name: str
) -> None:
    equipped.run("true")
    equipped.run("true", DOLFINX="latest")
    copy = tmp_path / "a copy"
    copy.mkdir()
    shutil.copy(CHECKOUT / "in-env", copy)
    shutil.copytree(CHECKOUT / "environment", copy / "environment")
    with (copy / "environment" / name).open("a") as packages:
        packages.write("python3-numba\n")
    subprocess.run(
        [str(copy / "in-env"), "true"], env=equipped.environment, check=True, capture_output=True
    )
    suites = [folder.split("-")[0] for folder in equipped.environments()]
    assert suites == ["sid", "trixie", "trixie"]


def test_a_failed_build_leaves_nothing(equipped: Host) -> None:
    code, out, _ = equipped.run("echo", "solved", FAKE_EXIT="25")
    assert code != 0
    assert out == ""
    assert equipped.environments() == []


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_an_interrupted_build_is_not_used_and_the_next_one_succeeds(
    equipped: Host, end: signal.Signals
) -> None:
    process = equipped.start("echo", "solved", FAKE_SECONDS="2")
    wait_for(lambda: "mmdebstrap fills" in equipped.log.read_text())
    os.killpg(process.pid, end)
    out, _ = process.communicate(timeout=10)
    assert process.returncode != 0
    assert out == ""
    assert equipped.environments() in ([], [".unfinished"])
    assert equipped.run("echo", "solved")[1] == "solved\n"
    (name,) = equipped.environments()
    assert name.startswith("trixie-")


def test_the_second_of_two_builds_waits_and_uses_the_first(equipped: Host) -> None:
    first = equipped.start("echo", "first", FAKE_SECONDS="1")
    wait_for(lambda: "mmdebstrap fills" in equipped.log.read_text())
    code, out, err = equipped.run("echo", "second")
    assert (code, out) == (0, "second\n")
    assert "waiting" in err
    assert first.communicate(timeout=10)[0] == "first\n"
    assert equipped.log.read_text().count("mmdebstrap fills") == 1


def test_the_top_of_the_sandbox_is_read_only_once_all_folders_of_the_machine_are_there(
    equipped: Host,
) -> None:
    """What is written into a folder that the sandbox alone has would be lost with it."""
    equipped.run("true")
    words = equipped.log.read_text().splitlines()[-1].split()
    at = words.index("--remount-ro")
    assert words[at + 1] == "/"
    assert not [word for word in words[at:] if "bind" in word or word == "--tmpfs"]
    private = [words[i + 1] for i, word in enumerate(words) if word == "--tmpfs"]
    assert private == ["/.shared-memory-of-open-mpi"]
    assert "--bind /tmp /tmp" in " ".join(words)


def wait_for(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + 10
    while not condition():
        assert time.monotonic() < end, "timed out"
        time.sleep(0.02)


def test_ranks_that_wait_yield_their_core() -> None:
    name = "OMPI_MCA_mpi_yield_when_idle"
    variables = {key: value for key, value in os.environ.items() if key != name}
    told = subprocess.run(
        [CHECKOUT / "in-env", "printenv", name], env=variables, capture_output=True, timeout=60
    )
    assert told.stdout == b"1\n"
    assert f"{name}=1" in (CHECKOUT / "Dockerfile").read_text()
