/* Faults under the calls of libc (open, read, write, rename, ...) that Python, HDF5 and SQLite make, not under those that
   libc makes itself (fwrite). LD_PRELOAD; see __main__.py.

   Counted are the operations on paths and descriptors below the place that `arm_faults` names; the n-th meets the fault. */

#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdarg.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <unistd.h>

enum { NONE, KILLED, FULL_DISK, DEVICE_ERROR, DEVICE_LOST, SHORT_WRITE, SHORT_READ };
enum { ANY, GROWS };
enum { DESCRIPTORS = 4096 };

static int kind, at, done;
static char place[4096];
static char below[DESCRIPTORS];

void arm_faults(int new_kind, int new_at, const char *new_place) {
    strncpy(place, new_place, sizeof place - 1);
    done = 0, at = new_at, kind = new_kind;
}

int operations_done(void) { return done; }

static int step(int what) { /* whether the operation fails, with errno */
    done++;
    if (kind == KILLED && done == at) kill(getpid(), SIGKILL);
    if (kind == FULL_DISK && done >= at && what == GROWS) return errno = ENOSPC;
    if ((kind == DEVICE_ERROR && done == at) || (kind == DEVICE_LOST && done >= at)) return errno = EIO;
    return 0;
}

static int ours(int fd) { return place[0] && fd >= 0 && fd < DESCRIPTORS && below[fd]; }

static int counted(int folder, const char *path) {
    if (!place[0] || !path) return 0;
    return path[0] == '/' ? !strncmp(path, place, strlen(place)) : ours(folder);
}

#define REAL(name) static __typeof__(name) *real; if (!real) real = (__typeof__(name) *)dlsym(RTLD_NEXT, #name)

#define OPENS(name, folder, path, parameters, ...)                              \
    int name parameters {                                                       \
        REAL(name);                                                             \
        mode_t mode = 0;                                                        \
        if (flags & (O_CREAT | __O_TMPFILE)) {                                  \
            va_list rest; va_start(rest, flags); mode = va_arg(rest, mode_t); va_end(rest); \
        }                                                                       \
        int mine = counted(folder, path);                                       \
        if (mine && step(flags & O_CREAT ? GROWS : ANY)) return -1;             \
        int fd = real(__VA_ARGS__, flags, mode);                                \
        if (fd >= 0 && fd < DESCRIPTORS) below[fd] = mine;                      \
        return fd;                                                              \
    }

OPENS(open, -1, path, (const char *path, int flags, ...), path)
OPENS(open64, -1, path, (const char *path, int flags, ...), path)
OPENS(openat, folder, path, (int folder, const char *path, int flags, ...), folder, path)
OPENS(openat64, folder, path, (int folder, const char *path, int flags, ...), folder, path)

/* A write comes in two halves, with a moment for a fault before and between; the first alone where writes are short. */
#define WRITES(name, parameters, first, second)                                 \
    ssize_t name parameters {                                                   \
        REAL(name);                                                             \
        size_t half = size / 2;                                                 \
        if (!ours(fd)) { half = size; return first; }                           \
        if (step(GROWS)) return -1;                                             \
        if (!half) { half = size; return first; }                               \
        ssize_t got = first;                                                    \
        if (got < (ssize_t)half || (kind == SHORT_WRITE && done >= at)) return got; \
        if (step(GROWS)) return kind == FULL_DISK ? got : -1;                   \
        ssize_t more = second;                                                  \
        return more < 0 ? got : got + more;                                     \
    }

#define READS(name, parameters, call)                                           \
    ssize_t name parameters {                                                   \
        REAL(name);                                                             \
        if (ours(fd)) {                                                         \
            if (step(ANY)) return -1;                                           \
            if (kind == SHORT_READ && done >= at && size > 1) size /= 2;        \
        }                                                                       \
        return call;                                                            \
    }

WRITES(write, (int fd, const void *from, size_t size), real(fd, from, half),
       real(fd, (const char *)from + half, size - half))
WRITES(pwrite, (int fd, const void *from, size_t size, off_t offset), real(fd, from, half, offset),
       real(fd, (const char *)from + half, size - half, offset + (off_t)half))
WRITES(pwrite64, (int fd, const void *from, size_t size, off64_t offset), real(fd, from, half, offset),
       real(fd, (const char *)from + half, size - half, offset + (off64_t)half))
READS(read, (int fd, void *to, size_t size), real(fd, to, size))
READS(pread, (int fd, void *to, size_t size, off_t offset), real(fd, to, size, offset))
READS(pread64, (int fd, void *to, size_t size, off64_t offset), real(fd, to, size, offset))

#define CALLS(name, mine, what, parameters, ...)                                \
    int name parameters { REAL(name); return mine && step(what) ? -1 : real(__VA_ARGS__); }

CALLS(rename, counted(-1, to), ANY, (const char *from, const char *to), from, to)
CALLS(renameat, counted(b, to), ANY, (int a, const char *from, int b, const char *to), a, from, b, to)
CALLS(unlink, counted(-1, path), ANY, (const char *path), path)
CALLS(unlinkat, counted(folder, path), ANY, (int folder, const char *path, int flags), folder, path, flags)
CALLS(mkdir, counted(-1, path), GROWS, (const char *path, mode_t mode), path, mode)
CALLS(rmdir, counted(-1, path), ANY, (const char *path), path)
CALLS(chmod, counted(-1, path), ANY, (const char *path, mode_t mode), path, mode)
CALLS(fchmod, ours(fd), ANY, (int fd, mode_t mode), fd, mode)
CALLS(link, counted(-1, to), GROWS, (const char *from, const char *to), from, to)
CALLS(fsync, ours(fd), ANY, (int fd), fd)
CALLS(fdatasync, ours(fd), ANY, (int fd), fd)
CALLS(ftruncate, ours(fd), GROWS, (int fd, off_t size), fd, size)
CALLS(ftruncate64, ours(fd), GROWS, (int fd, off64_t size), fd, size)

/* These two give the error itself. */
#define TAKES_ROOM(name, type)                                                  \
    int name(int fd, type from, type size) { REAL(name); return ours(fd) && step(GROWS) ? errno : real(fd, from, size); }
TAKES_ROOM(posix_fallocate, off_t)
TAKES_ROOM(posix_fallocate64, off64_t)

int close(int fd) { /* closed in any case, as Linux does it */
    REAL(close);
    int failed = ours(fd) && step(ANY), error = errno;
    if (fd >= 0 && fd < DESCRIPTORS) below[fd] = 0;
    int told = real(fd);
    return failed ? (errno = error, -1) : told;
}
