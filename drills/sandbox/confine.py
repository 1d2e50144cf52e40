"""What the child process takes away from itself before it runs foreign code.

Loaded by path in the child. Linux has four layers: resource limits, no capabilities, Landlock
(files, TCP, signals) and a system-call filter. Elsewhere the resource limits remain. Each function
returns what it reached, as a short text for `drills doctor`.

Sources: man pages prctl(2), capset(2), seccomp(2), landlock(7); Linux' Documentation/userspace-api.
"""

from __future__ import annotations

import ctypes
import errno
import os
import resource
import struct
import sys
from typing import Any

LINUX = sys.platform.startswith("linux")

PR_SET_PDEATHSIG, PR_SET_DUMPABLE, PR_SET_SECCOMP, PR_CAPBSET_DROP = 1, 4, 22, 24
PR_SET_MM, PR_SET_CHILD_SUBREAPER, PR_SET_NO_NEW_PRIVS, PR_CAP_AMBIENT = 35, 36, 38, 47
PR_SET_PTRACER = 0x59616D61


def _libc() -> Any:
    return ctypes.CDLL(None, use_errno=True)


def _call(function: Any, *arguments: Any) -> int:
    result = function(*arguments)
    if result < 0:
        code = ctypes.get_errno()
        raise OSError(code, os.strerror(code))
    return result


def _prctl(option: int, *values: int) -> int:
    words = [ctypes.c_ulong(value) for value in (*values, 0, 0, 0, 0)[:4]]
    return _call(_libc().prctl, ctypes.c_int(option), *words)


def limit(desired: dict[str, int]) -> str:
    """Set resource limits, soft and hard; that on processes is on top of those that run now."""
    missed = []
    for name, value in desired.items():
        kind = getattr(resource, f"RLIMIT_{name}", None)
        try:
            if kind is None:
                raise ValueError
            if name == "NPROC":
                with open("/proc/loadavg") as file:
                    value += int(file.read().split()[3].split("/")[1])
            # Only root may raise a hard limit; anyone may lower it.
            hard = resource.getrlimit(kind)[1]
            value = value if hard == resource.RLIM_INFINITY else min(value, hard)
            resource.setrlimit(kind, (value, value))
        except (OSError, ValueError):
            missed.append(name)
    return "without " + ", ".join(missed) if missed else "on"


def drop_capabilities() -> str:
    """Give up every capability, so that root is bound by limits and by Landlock like anyone."""
    for capability in range(64):
        try:
            _prctl(PR_CAPBSET_DROP, capability)
        except OSError:  # not root, or past the last one
            break
    try:
        _prctl(PR_CAP_AMBIENT, 4)  # clear all
    except OSError as error:
        if error.errno != errno.EINVAL:  # older kernels have none
            raise
    # Version 3 of the header, no process id (oneself), and three empty sets of capabilities.
    header = struct.pack("=Ii", 0x20080522, 0)
    _call(_libc().capset, header, bytes(24))
    return "on"


def settle(parent: int, hidden: bool) -> str:
    """Forbid new privileges and inspection by others, and die with the grader.

    Args:
        parent: the grader's process.
        hidden: whether others may not look; where the grader asks `ps`, it must see its mark.
    """
    # Needed by Landlock and by seccomp where the caller is not root.
    _prctl(PR_SET_NO_NEW_PRIVS, 1)
    if hidden:
        _prctl(PR_SET_DUMPABLE, 0)
    # SIGKILL when the parent dies; checked below, as it may have died before.
    _prctl(PR_SET_PDEATHSIG, 9)
    if os.getppid() != parent:  # it died before the call above
        os._exit(0)
    return "on"


# Landlock: rights by bit, and the version of the interface that knows them.
EXECUTE, WRITE_FILE, READ_FILE, READ_DIR = 1, 2, 4, 8
MAKE_CHAR, MAKE_BLOCK = 1 << 6, 1 << 11
RIGHTS = {1: (1 << 13) - 1, 2: (1 << 14) - 1, 3: (1 << 15) - 1, 5: (1 << 16) - 1}
FILE_RIGHTS = EXECUTE | WRITE_FILE | READ_FILE | 1 << 14 | 1 << 15  # ... truncate, ioctl


def landlock(readable: list[str], listable: list[str], writable: list[str]) -> str:
    """Allow reading in some places, writing in fewer, and nothing else.

    Args:
        readable: files, or folders with all in them.
        listable: folders whose names may be listed.
        writable: files or folders.
    """
    call = _libc().syscall
    # The kernel's version of the interface (flag 1) says which rights it knows.
    version = _call(call, 444, None, ctypes.c_size_t(0), 1)
    handled = max(rights for since, rights in RIGHTS.items() if since <= version)
    # Network rights came with version 4, scopes (signals, abstract sockets) with version 6.
    network = 3 if version >= 4 else 0
    scoped = 3 if version >= 6 else 0
    attributes = struct.pack("=QQQ", handled, network, scoped)
    size = 24 if version >= 6 else 16 if version >= 4 else 8
    ruleset = _call(call, 444, attributes, ctypes.c_size_t(size), 0)

    def allow(path: str, rights: int) -> None:
        try:
            place = os.open(path, os.O_PATH | os.O_CLOEXEC)
        except OSError:
            return  # what is not there needs no rule
        try:
            rights &= handled
            # The kernel refuses rules for files that name rights of directories.
            if not os.path.isdir(path):
                rights &= FILE_RIGHTS
            rule = struct.pack("=Qi", rights, place)
            _call(call, 445, ruleset, 1, rule, 0)
        finally:
            os.close(place)

    everything = handled & ~(EXECUTE | MAKE_CHAR | MAKE_BLOCK | 1 << 15)
    for path in readable:
        allow(path, READ_FILE | READ_DIR)
    for path in listable:
        allow(path, READ_DIR)
    for path in writable:
        allow(path, everything)
    # The rules take effect for this process and for all that it starts; they never loosen.
    _call(call, 446, ruleset, 0)
    os.close(ruleset)
    return f"on (version {version})"


# System calls by name: numbers on x86_64 and on aarch64 (-1 where there is none).
NUMBERS = {
    "fork": (57, -1),
    "vfork": (58, -1),
    "clone": (56, 220),
    "clone3": (435, 435),
    "execve": (59, 221),
    "execveat": (322, 281),
    "kill": (62, 129),
    "tkill": (200, 130),
    "tgkill": (234, 131),
    "rt_sigqueueinfo": (129, 138),
    "rt_tgsigqueueinfo": (297, 240),
    "pidfd_send_signal": (424, 424),
    "pidfd_getfd": (438, 438),
    "ptrace": (101, 117),
    "process_vm_readv": (310, 270),
    "process_vm_writev": (311, 271),
    "process_madvise": (440, 440),
    "process_mrelease": (448, 448),
    "kcmp": (312, 272),
    "prlimit64": (302, 261),
    "sched_setparam": (142, 118),
    "sched_setscheduler": (144, 119),
    "sched_setaffinity": (203, 122),
    "sched_setattr": (314, 274),
    "setpriority": (141, 140),
    "ioprio_set": (251, 30),
    "migrate_pages": (256, 238),
    "move_pages": (279, 239),
    "socket": (41, 198),
    "socketpair": (53, 199),
    "connect": (42, 203),
    "bind": (49, 200),
    "setsid": (112, 157),
    "setpgid": (109, 154),
    # System V's objects are found by number, not by name: those of other processes are in reach.
    "shmget": (29, 194),
    "shmat": (30, 196),
    "shmctl": (31, 195),
    "shmdt": (67, 197),
    "semget": (64, 190),
    "semctl": (66, 191),
    "semop": (65, 193),
    "semtimedop": (220, 192),
    "msgget": (68, 186),
    "msgctl": (71, 187),
    "msgrcv": (70, 188),
    "msgsnd": (69, 189),
    "mq_open": (240, 180),
    "mq_unlink": (241, 181),
    "memfd_create": (319, 279),
    "memfd_secret": (447, 447),
    "mount": (165, 40),
    "umount2": (166, 39),
    "pivot_root": (155, 41),
    "chroot": (161, 51),
    "unshare": (272, 97),
    "setns": (308, 268),
    "open_tree": (428, 428),
    "move_mount": (429, 429),
    "fsopen": (430, 430),
    "fsconfig": (431, 431),
    "fsmount": (432, 432),
    "fspick": (433, 433),
    "mount_setattr": (442, 442),
    "open_tree_attr": (467, 467),
    "quotactl_fd": (443, 443),
    "name_to_handle_at": (303, 264),
    "open_by_handle_at": (304, 265),
    "bpf": (321, 280),
    "perf_event_open": (298, 241),
    "userfaultfd": (323, 282),
    "io_uring_setup": (425, 425),
    "io_uring_enter": (426, 426),
    "io_uring_register": (427, 427),
    "io_setup": (206, 0),
    "add_key": (248, 217),
    "request_key": (249, 218),
    "keyctl": (250, 219),
    "personality": (135, 92),
    "syslog": (103, 116),
    "acct": (163, 89),
    "quotactl": (179, 60),
    "swapon": (167, 224),
    "swapoff": (168, 225),
    "reboot": (169, 142),
    "sethostname": (170, 161),
    "setdomainname": (171, 162),
    "settimeofday": (164, 170),
    "clock_settime": (227, 112),
    "adjtimex": (159, 171),
    "clock_adjtime": (305, 266),
    "init_module": (175, 105),
    "finit_module": (313, 273),
    "delete_module": (176, 106),
    "kexec_load": (246, 104),
    "kexec_file_load": (320, 294),
    "fanotify_init": (300, 262),
    "inotify_init": (253, -1),
    "inotify_init1": (294, 26),
    "iopl": (172, -1),
    "ioperm": (173, -1),
    "modify_ldt": (154, -1),
    "mknod": (133, -1),
    "mknodat": (259, 33),
    # Landlock does not look at these: an owner could change the mode or the times of any own file.
    "chmod": (90, -1),
    "fchmod": (91, 52),
    "fchmodat": (268, 53),
    "fchmodat2": (452, 452),
    "chown": (92, -1),
    "fchown": (93, 55),
    "lchown": (94, -1),
    "fchownat": (260, 54),
    "utime": (132, -1),
    "utimes": (235, -1),
    "futimesat": (261, -1),
    "utimensat": (280, 88),
    "setxattr": (188, 5),
    "lsetxattr": (189, 6),
    "fsetxattr": (190, 7),
    "setxattrat": (463, 463),
    "removexattr": (197, 14),
    "lremovexattr": (198, 15),
    "fremovexattr": (199, 16),
    "removexattrat": (466, 466),
    "file_setattr": (469, 469),
    "fcntl": (72, 25),
    "ioctl": (16, 29),
    "prctl": (157, 167),
}
MACHINES = {"x86_64": (0, 0xC000003E), "aarch64": (1, 0xC00000B7)}

# Calls that may name a process: the argument that does, and whether 0 (oneself) is allowed.
OWN_ONLY = {
    "kill": (0, False),
    "tkill": (0, False),
    "tgkill": (0, False),
    "rt_sigqueueinfo": (0, False),
    "rt_tgsigqueueinfo": (0, False),
    "prlimit64": (0, True),
    "sched_setparam": (0, True),
    "sched_setscheduler": (0, True),
    "sched_setaffinity": (0, True),
    "sched_setattr": (0, True),
    "setpriority": (1, True),
}
# Calls that are refused for some values of an argument only.
REFUSED_VALUES = {
    "setpriority": (0, (1, 2)),  # of a group, of a user
    "fcntl": (1, (8, 15, 1024, 1026)),  # signals to another owner, holding up who opens a file
    "prctl": (
        0,
        (PR_SET_PDEATHSIG, PR_SET_DUMPABLE, PR_SET_MM, PR_SET_CHILD_SUBREAPER, PR_SET_PTRACER),
    ),
}
# Calls that are allowed for some values of their arguments only.
ALLOWED_VALUES = {
    # What a terminal is asked, bytes waiting, not to wait, closing on exec. Others change flags of
    # files that may only be read, make subvolumes, type into a terminal or signal.
    "ioctl": ((1, (0x5401, 0x802C542A, 0x5413, 0x540F, 0x541B, 0x5421, 0x5450, 0x5451)),),
    # Streams within the process; datagrams could be sent to any address.
    "socketpair": ((0, (1,)), (1, (1, 0x801, 0x80001, 0x80801))),
}

LOAD, JEQ, JGE, JSET, RETURN = 0x20, 0x15, 0x35, 0x45, 0x06
ALLOW, REFUSE = 0x7FFF0000, 0x00050000
CLONE_THREAD = 0x10000


def filter_program(machine: str, own: int) -> bytes:
    """Return the system-call filter as BPF: refuses a list of calls, allows the rest.

    Args:
        machine: `x86_64` or `aarch64`.
        own: process id to which signals may be sent.

    Raises:
        KeyError: for another machine.
    """
    column, architecture = MACHINES[machine]
    program: list[tuple[int, int, int, int]] = []
    no, missing = REFUSE | errno.EPERM, REFUSE | errno.ENOSYS

    def argument(index: int) -> tuple[int, int, int, int]:
        return (LOAD, 0, 0, 16 + 8 * index)  # its low word; both machines are little-endian

    program += [(LOAD, 0, 0, 4), (JEQ, 1, 0, architecture), (RETURN, 0, 0, no), (LOAD, 0, 0, 0)]
    if machine == "x86_64":  # the x32 numbers are a second door to the same calls
        program += [(JGE, 0, 1, 0x40000000), (RETURN, 0, 0, no)]
    for name, numbers in NUMBERS.items():
        number = numbers[column]
        if number < 0:
            continue
        block: list[tuple[int, int, int, int]] = []
        if name == "clone":
            block += [argument(0), (JSET, 0, 1, CLONE_THREAD), (RETURN, 0, 0, ALLOW)]
        if name in REFUSED_VALUES:
            index, values = REFUSED_VALUES[name]
            block.append(argument(index))
            for value in values:
                block += [(JEQ, 0, 1, value), (RETURN, 0, 0, no)]
            if name not in OWN_ONLY:
                block.append((RETURN, 0, 0, ALLOW))
        for index, values in ALLOWED_VALUES.get(name, ()):
            block.append(argument(index))
            block += [(JEQ, len(values) - i, 0, value) for i, value in enumerate(values)]
            block.append((RETURN, 0, 0, no))
        if name in ALLOWED_VALUES:
            block.append((RETURN, 0, 0, ALLOW))
        if name in OWN_ONLY:
            index, zero = OWN_ONLY[name]
            block.append(argument(index))
            for value in (own, 0) if zero else (own,):
                block += [(JEQ, 0, 1, value), (RETURN, 0, 0, ALLOW)]
        block.append((RETURN, 0, 0, missing if name == "clone3" else no))
        program += [(JEQ, 0, len(block), number), *block]
    program.append((RETURN, 0, 0, ALLOW))
    return b"".join(struct.pack("=HBBI", *instruction) for instruction in program)


def system_calls() -> str:
    """Refuse system calls that no answer needs: other processes, sockets, mounts, ..."""
    machine = os.uname().machine
    if machine not in MACHINES or sys.byteorder != "little" or ctypes.sizeof(ctypes.c_void_p) != 8:
        return f"off (no table for {machine})"
    program = filter_program(machine, os.getpid())
    buffer = ctypes.create_string_buffer(program, len(program))
    header = ctypes.create_string_buffer(
        struct.pack("=H6xQ", len(program) // 8, ctypes.addressof(buffer)), 16
    )
    _prctl(PR_SET_SECCOMP, 2, ctypes.addressof(header))
    return "on"


def reached(function: Any, *arguments: Any) -> str:
    """Return what a layer reached, or why it is off."""
    if not LINUX:
        return "off (not Linux)"
    try:
        return function(*arguments)
    except OSError as error:
        return f"off ({error.strerror})"
