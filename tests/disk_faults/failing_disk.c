/* A disk that fails once, preloaded into a process (LD_PRELOAD), so that no test needs ptrace or another file system.
 *
 * It watches what the process does with files below DISK_FAULT_ROOT: `open`, `mkdir`, `sync` (fsync, fdatasync), `rename`, `write`, `read`
 * and `close`, with all forms of each. Each such operation is a line of DISK_FAULT_LOG, if that is set. The operation
 * DISK_FAULT_OPERATION number DISK_FAULT_NUMBER, from 1, fails with the error number DISK_FAULT_ERROR; the line is then followed by
 * ` failed`. Renames and new folders are caught as system calls (seccomp), because not all go through the C library. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <signal.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <ucontext.h>
#include <unistd.h>

enum { OPEN, MKDIR, SYNC, RENAME, WRITE, READ, CLOSE, OPERATIONS };
static const char *const NAMES[OPERATIONS] = {"open", "mkdir", "sync", "rename", "write", "read", "close"};
static unsigned long counts[OPERATIONS];

/* Counts an operation on a path; whether it fails. Only raw system calls, so that it does not watch itself. */
static int fails_on_path(int operation, const char *path) {
    const char *root = getenv("DISK_FAULT_ROOT");
    if (root == NULL || strncmp(path, root, strlen(root)) != 0)
        return 0;
    unsigned long number = __atomic_add_fetch(&counts[operation], 1, __ATOMIC_SEQ_CST);
    const char *asked = getenv("DISK_FAULT_OPERATION");
    const char *at = getenv("DISK_FAULT_NUMBER");
    int fails = asked != NULL && at != NULL && strcmp(asked, NAMES[operation]) == 0 && strtoul(at, NULL, 10) == number;
    const char *log = getenv("DISK_FAULT_LOG");
    if (log != NULL && (fails || asked == NULL)) {
        char line[PATH_MAX + 64];
        int length = snprintf(line, sizeof line, "%s %s%s\n", NAMES[operation], path + strlen(root), fails ? " failed" : "");
        long fd = syscall(SYS_openat, AT_FDCWD, log, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600);
        if (fd >= 0) {
            syscall(SYS_write, fd, line, (size_t)length);
            syscall(SYS_close, fd);
        }
    }
    if (fails)
        errno = atoi(getenv("DISK_FAULT_ERROR"));
    return fails;
}

/* The same for what a link of /proc/self leads to, with a name behind it. */
static int fails_at(int operation, const char *link, const char *name) {
    int before = errno;
    char path[2 * PATH_MAX];
    long length = syscall(SYS_readlinkat, AT_FDCWD, link, path, PATH_MAX - 1);
    errno = before;
    if (length < 0)
        return 0;
    snprintf(path + length, sizeof path - (size_t)length, "%s%s", *name ? "/" : "", name);
    return fails_on_path(operation, path);
}

static int fails(int operation, int fd) {
    char link[64];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    return fails_at(operation, link, "");
}

static int fails_on_name(int operation, const char *name) {
    return name[0] == '/' ? fails_on_path(operation, name) : fails_at(operation, "/proc/self/cwd", name);
}

#define REAL(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))
#define WRAP(result, name, operation, fd, parameters, arguments)                                                              \
    result name parameters {                                                                                                  \
        return fails(operation, fd) ? -1 : REAL(name) arguments;                                                              \
    }

WRAP(int, fsync, SYNC, fd, (int fd), (fd))
WRAP(int, fdatasync, SYNC, fd, (int fd), (fd))
WRAP(ssize_t, write, WRITE, fd, (int fd, const void *from, size_t bytes), (fd, from, bytes))
WRAP(ssize_t, pwrite, WRITE, fd, (int fd, const void *from, size_t bytes, off_t at), (fd, from, bytes, at))
WRAP(ssize_t, pwrite64, WRITE, fd, (int fd, const void *from, size_t bytes, off64_t at), (fd, from, bytes, at))
WRAP(ssize_t, writev, WRITE, fd, (int fd, const struct iovec *from, int parts), (fd, from, parts))
WRAP(ssize_t, copy_file_range, WRITE, to, (int from, off64_t *from_at, int to, off64_t *to_at, size_t bytes, unsigned flags),
     (from, from_at, to, to_at, bytes, flags))
WRAP(ssize_t, read, READ, fd, (int fd, void *to, size_t bytes), (fd, to, bytes))
WRAP(ssize_t, pread, READ, fd, (int fd, void *to, size_t bytes, off_t at), (fd, to, bytes, at))
WRAP(ssize_t, pread64, READ, fd, (int fd, void *to, size_t bytes, off64_t at), (fd, to, bytes, at))
WRAP(ssize_t, readv, READ, fd, (int fd, const struct iovec *to, int parts), (fd, to, parts))

#define WRAP_OPEN(name, operation_on_name, parameters, arguments)                                                             \
    int name parameters {                                                                                                     \
        va_list more;                                                                                                         \
        va_start(more, flags);                                                                                                \
        mode_t mode = flags & (O_CREAT | O_TMPFILE) ? va_arg(more, mode_t) : 0;                                               \
        va_end(more);                                                                                                         \
        return operation_on_name ? -1 : REAL(name) arguments;                                                                 \
    }

WRAP_OPEN(open, fails_on_name(OPEN, path), (const char *path, int flags, ...), (path, flags, mode))
WRAP_OPEN(open64, fails_on_name(OPEN, path), (const char *path, int flags, ...), (path, flags, mode))
WRAP_OPEN(openat, fails_on_name(OPEN, path), (int folder, const char *path, int flags, ...), (folder, path, flags, mode))
WRAP_OPEN(openat64, fails_on_name(OPEN, path), (int folder, const char *path, int flags, ...), (folder, path, flags, mode))

/* The file is closed nevertheless, as on Linux. */
int close(int fd) {
    int has_failed = fails(CLOSE, fd), error = errno;
    int closed = REAL(close)(fd);
    if (has_failed)
        errno = error;
    return has_failed ? -1 : closed;
}

/* A sixth argument, which these calls do not have, lets them pass. */
#define PASSES 0x6469736b

static void trapped(int signal, siginfo_t *info, void *context) {
    (void)signal;
    greg_t *registers = ((ucontext_t *)context)->uc_mcontext.gregs;
    long number = info->si_syscall, first = registers[REG_RDI], second = registers[REG_RSI], third = registers[REG_RDX];
    long fourth = registers[REG_R10], fifth = registers[REG_R8];
    int before = errno, is_folder = number == SYS_mkdir || number == SYS_mkdirat;
    int has_second = number == SYS_mkdirat || number == SYS_rename;
    const char *name = (const char *)(number == SYS_mkdir ? first : has_second ? second : fourth);
    long result = fails_on_name(is_folder ? MKDIR : RENAME, name) ? -1 : syscall(number, first, second, third, fourth, fifth, PASSES);
    registers[REG_RAX] = result == -1 ? -errno : result;
    errno = before;
}

__attribute__((constructor)) static void trap(void) {
    struct sigaction action = {.sa_sigaction = trapped, .sa_flags = SA_SIGINFO | SA_NODEFER};
    sigaction(SIGSYS, &action, NULL);
#define ON(call, to) BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, call, to, 0)
    struct sock_filter filter[] = {
        BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, nr)),
        ON(SYS_rename, 5), ON(SYS_renameat, 4), ON(SYS_renameat2, 3), ON(SYS_mkdir, 2), ON(SYS_mkdirat, 1),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW),
        BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, args[5])),
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, PASSES, 0, 1),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_TRAP),
    };
    struct sock_fprog program = {sizeof filter / sizeof *filter, filter};
    prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0);
    prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program);
}
