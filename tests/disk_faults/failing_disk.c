/* A disk that fails once, preloaded into a process (LD_PRELOAD), so that no test needs ptrace or another file system.
 *
 * It watches what the process does with files below DISK_FAULT_ROOT: `sync` (fsync, fdatasync), `rename`, `write` and `read`, with all
 * forms of each. Each such operation is a line of DISK_FAULT_LOG, if that is set. The operation DISK_FAULT_OPERATION number
 * DISK_FAULT_NUMBER, from 1, fails with the error number DISK_FAULT_ERROR; the line is then followed by ` failed`. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/syscall.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <unistd.h>

enum { SYNC, RENAME, WRITE, READ, OPERATIONS };
static const char *const NAMES[OPERATIONS] = {"sync", "rename", "write", "read"};
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

static int fails(int operation, int fd) {
    int before = errno;
    char link[64], path[PATH_MAX];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    long length = syscall(SYS_readlinkat, AT_FDCWD, link, path, sizeof path - 1);
    errno = before;
    if (length < 0)
        return 0;
    path[length] = 0;
    return fails_on_path(operation, path);
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

int rename(const char *from, const char *to) {
    return fails_on_path(RENAME, to) ? -1 : REAL(rename)(from, to);
}
