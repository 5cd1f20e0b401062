/*
 * proximity_mailbox.h: shm://NAME, a mailbox in shared memory: one writer, any readers, each at its own pace. Linux.
 *
 * The file /dev/shm/proximity.NAME, with permissions for its owner only, has a header
 * (proximity_mailbox_header) and a ring of bytes. Positions count bytes since the mailbox was created; a
 * position is at `position % ring` of the ring, and messages wrap around its end. Each message starts at a
 * multiple of 16 with its size (u32, and 12 unused bytes), and is padded to the next multiple of 16. The
 * writer raises `floor` beyond the bytes it is about to overwrite, writes, and then raises `head`. A reader
 * copies from its position on and accepts the copy if `floor` is not beyond that position afterwards: the
 * message is then complete, and neither side waits.
 *
 * The writer has an exclusive lock of the open file (F_OFD_SETLK), which the system releases when it dies. A
 * new writer replaces a dead one: it marks the old mailbox as closed, and readers open the new one. A mailbox
 * is replaced in the same way to make room for longer messages.
 *
 *   proximity_mailbox box;
 *   if (proximity_mailbox_open(&box, "proximity") == PROXIMITY_MAILBOX_OK)
 *       size = proximity_mailbox_read(&box, message, sizeof message);
 *
 * After a fork the child must close an inherited writer, which does not affect its parent; while it is open,
 * the name of a killed parent stays in use.
 *
 * Validate messages like those from any other transport. One thread uses a proximity_mailbox at a time.
 * Memory is mapped read-only except by the writer.
 */
#ifndef PROXIMITY_MAILBOX_H
#define PROXIMITY_MAILBOX_H

#include <errno.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <time.h>
#ifdef __linux__
#ifndef _GNU_SOURCE
#error "define _GNU_SOURCE before all headers: mailboxes need futexes and locks of open files"
#endif
#include <fcntl.h>
#include <linux/futex.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#ifndef F_OFD_GETLK
#define F_OFD_GETLK 36
#define F_OFD_SETLK 37
#endif
#endif

#define PROXIMITY_MAILBOX_FOLDER "/dev/shm/"
#define PROXIMITY_MAILBOX_MAGIC UINT64_C(0x584f424c49414d44) /* "DMAILBOX" */
#define PROXIMITY_MAILBOX_LAYOUT 1u
#define PROXIMITY_MAILBOX_MIN_RING (UINT64_C(1) << 17)
#define PROXIMITY_MAILBOX_MAX_RING (UINT64_C(1) << 30)
#define PROXIMITY_MAILBOX_NOTHING (-1)

enum proximity_mailbox_outcome {
    PROXIMITY_MAILBOX_OK = 0,
    PROXIMITY_MAILBOX_NOBODY,  /* there is no mailbox of that name, or no writer */
    PROXIMITY_MAILBOX_NAME,    /* too long, or with a slash */
    PROXIMITY_MAILBOX_IN_USE,  /* by another writer */
    PROXIMITY_MAILBOX_OWNER,   /* of another user, or with permissions for others */
    PROXIMITY_MAILBOX_FOREIGN, /* not a mailbox, or an incomplete one */
    PROXIMITY_MAILBOX_VERSION, /* of another layout */
    PROXIMITY_MAILBOX_SYSTEM   /* a system error, see errno */
};

typedef struct proximity_mailbox_header {
    uint64_t magic;
    uint32_t layout;
    uint32_t header_size;
    uint64_t ring;      /* bytes, a power of two */
    int64_t writer;     /* its process; 0: closed, the next mailbox is another file */
    int64_t written_ns; /* time of the newest message, CLOCK_MONOTONIC: a heartbeat */
    uint64_t unused[3];
    uint64_t head;      /* end of the newest message */
    uint64_t floor;     /* messages before it are overwritten */
    uint64_t newest;    /* start of the newest message */
    uint32_t count;     /* of messages; readers wait on this number (futex) */
    uint32_t unused_too;
    uint64_t unused_at_the_end[4];
} proximity_mailbox_header;

typedef struct proximity_mailbox {
    proximity_mailbox_header *header; /* NULL: closed */
    uint64_t ring, position;
    uint64_t overtaken; /* number of times that the writer was a whole ring ahead */
    int file, is_writer;
    char path[256];
} proximity_mailbox;

static inline int64_t proximity_mailbox_now_ns(void)
{
    struct timespec now;

#ifdef __linux__
    clock_gettime(CLOCK_MONOTONIC, &now);
#else
    timespec_get(&now, TIME_UTC);
#endif
    return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

static inline const char *proximity_mailbox_reason(int outcome)
{
    static const char *const reasons[] = {
        "is open",
        "nobody publishes there",
        "a name of shared memory has at most 200 characters, and no slash",
        "is in use: another program publishes there",
        "it belongs to another user, or others may open it (expected permissions 0600)",
        "it is not a mailbox of proximity, or damaged (expected to be removed by whoever made it)",
        "it is of another version of proximity (expected the same version at both ends)",
        "the system refuses",
    };
    return outcome >= 0 && outcome <= PROXIMITY_MAILBOX_SYSTEM ? reasons[outcome] : "it is unknown why";
}

static inline uint64_t proximity_mailbox_room_for(uint64_t size)
{
    return 16 + ((size + 15) & ~UINT64_C(15));
}

static inline uint8_t *proximity_mailbox_bytes(const proximity_mailbox *box)
{
    return (uint8_t *)(box->header + 1);
}

/* Copy from the ring, around its end. */
static inline void proximity_mailbox_take(const proximity_mailbox *box, uint64_t position, void *to, uint64_t size)
{
    uint64_t at = position & (box->ring - 1), first = size < box->ring - at ? size : box->ring - at;

    memcpy(to, proximity_mailbox_bytes(box) + at, first);
    memcpy((uint8_t *)to + first, proximity_mailbox_bytes(box), size - first);
}

static inline void proximity_mailbox_put(proximity_mailbox *box, uint64_t position, const void *from, uint64_t size)
{
    uint64_t at = position & (box->ring - 1), first = size < box->ring - at ? size : box->ring - at;

    memcpy(proximity_mailbox_bytes(box) + at, from, first);
    memcpy(proximity_mailbox_bytes(box), (const uint8_t *)from + first, size - first);
}

static inline void proximity_mailbox_wake(proximity_mailbox *box)
{
    __atomic_add_fetch(&box->header->count, 1, __ATOMIC_SEQ_CST);
#ifdef __linux__
    syscall(SYS_futex, &box->header->count, FUTEX_WAKE, INT32_MAX, NULL, NULL, 0);
#endif
}

/* Test whether the writer has closed it: the remaining messages may be read, and the name belongs to another file. */
static inline int proximity_mailbox_is_closed(const proximity_mailbox *box)
{
    return __atomic_load_n(&box->header->writer, __ATOMIC_ACQUIRE) == 0;
}

#ifdef __linux__
/* Take the lock of the open file, or (F_OFD_GETLK) test whether another process has it; return 0 if so. */
static inline int proximity_mailbox_lock(int file, int command)
{
    struct flock lock;

    memset(&lock, 0, sizeof lock);
    lock.l_type = F_WRLCK;
    lock.l_whence = SEEK_SET;
    if (fcntl(file, command, &lock) != 0)
        return -1;
    return command == F_OFD_GETLK && lock.l_type == F_UNLCK ? -1 : 0;
}

/* Map an open file, if it is a valid mailbox. */
static inline int proximity_mailbox_map(proximity_mailbox *box, int file, int is_writer)
{
    proximity_mailbox_header known;
    struct stat status;
    void *memory;

    if (fstat(file, &status) != 0)
        return PROXIMITY_MAILBOX_SYSTEM;
    if (!S_ISREG(status.st_mode) || status.st_uid != geteuid() || (status.st_mode & 077) != 0)
        return PROXIMITY_MAILBOX_OWNER;
    if (pread(file, &known, sizeof known, 0) != (ssize_t)sizeof known || known.magic != PROXIMITY_MAILBOX_MAGIC)
        return PROXIMITY_MAILBOX_FOREIGN;
    if (known.layout != PROXIMITY_MAILBOX_LAYOUT || known.header_size != sizeof known)
        return PROXIMITY_MAILBOX_VERSION;
    if (known.ring < PROXIMITY_MAILBOX_MIN_RING || known.ring > PROXIMITY_MAILBOX_MAX_RING
        || (known.ring & (known.ring - 1)) != 0 || (uint64_t)status.st_size != sizeof known + known.ring)
        return PROXIMITY_MAILBOX_FOREIGN;
    memory = mmap(NULL, sizeof known + known.ring, PROT_READ | (is_writer ? PROT_WRITE : 0), MAP_SHARED, file, 0);
    if (memory == MAP_FAILED)
        return PROXIMITY_MAILBOX_SYSTEM;
    box->header = (proximity_mailbox_header *)memory;
    box->ring = known.ring;
    box->file = file;
    box->is_writer = is_writer;
    return PROXIMITY_MAILBOX_OK;
}

static inline int proximity_mailbox_begin(proximity_mailbox *box, const char *name)
{
    int length;

    memset(box, 0, sizeof *box);
    box->file = -1;
    length = snprintf(box->path, sizeof box->path, PROXIMITY_MAILBOX_FOLDER "proximity.%s", name);
    return name[0] == '\0' || strchr(name, '/') != NULL || length < 0 || length > 219 ? PROXIMITY_MAILBOX_NAME
                                                                                      : PROXIMITY_MAILBOX_OK;
}

/* Close the mailbox; a writer, but not its forked child, marks it as closed for its readers and releases the
   name. Closing twice has no effect. */
static inline void proximity_mailbox_close(proximity_mailbox *box)
{
    struct stat here, there;

    if (box->header == NULL)
        return;
    if (box->is_writer && __atomic_load_n(&box->header->writer, __ATOMIC_RELAXED) == getpid()) {
        if (fstat(box->file, &here) == 0 && lstat(box->path, &there) == 0 && here.st_ino == there.st_ino)
            unlink(box->path);
        __atomic_store_n(&box->header->writer, 0, __ATOMIC_RELEASE);
        proximity_mailbox_wake(box);
    }
    munmap(box->header, sizeof *box->header + box->ring);
    close(box->file);
    box->header = NULL;
    box->file = -1;
}

/* Reason why a file could not be opened, by errno. */
static inline int proximity_mailbox_not_opened(void)
{
    return errno == ENOENT   ? PROXIMITY_MAILBOX_NOBODY
           : errno == EACCES ? PROXIMITY_MAILBOX_OWNER
           : errno == ELOOP  ? PROXIMITY_MAILBOX_FOREIGN
                             : PROXIMITY_MAILBOX_SYSTEM;
}

/* Open the mailbox of that name for reading, at its newest message. */
static inline int proximity_mailbox_open(proximity_mailbox *box, const char *name)
{
    int file, outcome = proximity_mailbox_begin(box, name);

    if (outcome != PROXIMITY_MAILBOX_OK)
        return outcome;
    file = open(box->path, O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
    if (file < 0)
        return proximity_mailbox_not_opened();
    outcome = proximity_mailbox_map(box, file, 0);
    if (outcome != PROXIMITY_MAILBOX_OK) {
        close(file);
        return outcome;
    }
    if (proximity_mailbox_is_closed(box)) { /* and not yet unlinked */
        proximity_mailbox_close(box);
        return PROXIMITY_MAILBOX_NOBODY;
    }
    box->position = __atomic_load_n(&box->header->newest, __ATOMIC_ACQUIRE);
    return PROXIMITY_MAILBOX_OK;
}
#endif

/* Test whether a message is waiting. */
static inline int proximity_mailbox_has(const proximity_mailbox *box)
{
    return __atomic_load_n(&box->header->head, __ATOMIC_ACQUIRE) != box->position;
}

#ifdef __linux__
/* Test whether a living writer has it open. */
static inline int proximity_mailbox_is_written(const proximity_mailbox *box)
{
    return box->header != NULL && !proximity_mailbox_is_closed(box)
           && (box->is_writer || proximity_mailbox_lock(box->file, F_OFD_GETLK) == 0);
}

/* Test whether no further message will come: it was closed, or its name belongs to another file, or to none. */
static inline int proximity_mailbox_is_over(const proximity_mailbox *box)
{
    struct stat here, there;

    return proximity_mailbox_is_closed(box) || fstat(box->file, &here) != 0
           || lstat(box->path, &there) != 0 || here.st_ino != there.st_ino;
}
#endif

/* Copy the next message, cut to `room` bytes; return its size, or PROXIMITY_MAILBOX_NOTHING. */
static inline int64_t proximity_mailbox_read(proximity_mailbox *box, void *to, uint64_t room)
{
    const proximity_mailbox_header *header = box->header;
    int tries;

    for (tries = 0; tries < 16; tries++) {
        uint64_t head = __atomic_load_n(&header->head, __ATOMIC_ACQUIRE), position = box->position;
        uint32_t size;

        if (position == head)
            return PROXIMITY_MAILBOX_NOTHING;
        proximity_mailbox_take(box, position, &size, sizeof size);
        if (size <= box->ring - 16)
            proximity_mailbox_take(box, position + 16, to, size < room ? size : room);
        __atomic_thread_fence(__ATOMIC_ACQUIRE);
        if (__atomic_load_n(&header->floor, __ATOMIC_RELAXED) <= position && position < head) {
            /* Only a corrupt mailbox is in this state. */
            if (proximity_mailbox_room_for(size) > head - position || head - position > box->ring) {
                box->position = head;
                return PROXIMITY_MAILBOX_NOTHING;
            }
            box->position = position + proximity_mailbox_room_for(size);
            return size;
        }
        box->overtaken++;
        box->position = __atomic_load_n(&header->floor, __ATOMIC_ACQUIRE);
    }
    return PROXIMITY_MAILBOX_NOTHING;
}

/* Skip all waiting messages but the newest. */
static inline void proximity_mailbox_skip(proximity_mailbox *box)
{
    uint64_t newest = __atomic_load_n(&box->header->newest, __ATOMIC_ACQUIRE);

    box->position = newest > box->position ? newest : box->position;
}

#ifdef __linux__
/* Wait until a message arrives, the mailbox is closed, that instant is reached or a signal arrives; return
   whether a message is waiting. */
static inline int proximity_mailbox_wait(proximity_mailbox *box, int64_t until_ns)
{
    const proximity_mailbox_header *header = box->header;
    struct timespec until;
    uint32_t count = __atomic_load_n(&header->count, __ATOMIC_SEQ_CST);

    if (!proximity_mailbox_has(box) && !proximity_mailbox_is_closed(box)) {
        until.tv_sec = until_ns / 1000000000;
        until.tv_nsec = until_ns % 1000000000;
        syscall(SYS_futex, &header->count, FUTEX_WAIT_BITSET, count, &until, NULL, FUTEX_BITSET_MATCH_ANY);
    }
    return proximity_mailbox_has(box);
}

/* Take the lock of the existing mailbox of that name, if its writer is dead. */
static inline int proximity_mailbox_of_the_dead(const proximity_mailbox *box, proximity_mailbox *dead)
{
    struct stat here, there;
    int outcome, file = open(box->path, O_RDWR | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);

    *dead = *box;
    if (file < 0)
        return proximity_mailbox_not_opened();
    outcome = proximity_mailbox_map(dead, file, 1);
    if (outcome == PROXIMITY_MAILBOX_OK && proximity_mailbox_lock(file, F_OFD_SETLK) != 0)
        outcome = PROXIMITY_MAILBOX_IN_USE;
    if (outcome == PROXIMITY_MAILBOX_OK && lstat(box->path, &there) != 0)
        outcome = PROXIMITY_MAILBOX_NOBODY; /* closed just now */
    else if (outcome == PROXIMITY_MAILBOX_OK && (fstat(file, &here) != 0 || here.st_ino != there.st_ino))
        outcome = PROXIMITY_MAILBOX_IN_USE; /* another writer was faster */
    if (outcome == PROXIMITY_MAILBOX_OK) {
        __atomic_store_n(&dead->header->writer, getpid(), __ATOMIC_RELEASE);
        return outcome;
    }
    if (dead->header != NULL)
        munmap(dead->header, sizeof *dead->header + dead->ring);
    dead->header = NULL;
    close(file);
    return outcome;
}

/* Create an unnamed file, complete and locked. */
static inline int proximity_mailbox_new_file(proximity_mailbox *box, uint64_t ring)
{
    proximity_mailbox_header header;
    int outcome = PROXIMITY_MAILBOX_SYSTEM, error, file;

    file = open(PROXIMITY_MAILBOX_FOLDER, O_RDWR | O_TMPFILE | O_CLOEXEC, 0600);
    if (file < 0)
        return outcome;
    memset(&header, 0, sizeof header);
    header.magic = PROXIMITY_MAILBOX_MAGIC;
    header.layout = PROXIMITY_MAILBOX_LAYOUT;
    header.header_size = sizeof header;
    header.ring = ring;
    header.writer = getpid();
    header.written_ns = proximity_mailbox_now_ns();
    /* Allocate everything now: a process that runs out of memory while it writes is killed. */
    error = posix_fallocate(file, 0, (off_t)(sizeof header + ring));
    if (error != 0)
        errno = error;
    else if (fchmod(file, 0600) == 0 && pwrite(file, &header, sizeof header, 0) == (ssize_t)sizeof header
             && proximity_mailbox_lock(file, F_OFD_SETLK) == 0)
        outcome = proximity_mailbox_map(box, file, 1);
    if (outcome != PROXIMITY_MAILBOX_OK) {
        error = errno;
        close(file);
        errno = error;
    }
    return outcome;
}

/* Create a mailbox for messages of up to `largest` bytes. It replaces `before`, whose lock this process has,
   and whose readers then open the new one; `before->header` is NULL if there is none. */
static inline int proximity_mailbox_replace(proximity_mailbox *box, proximity_mailbox *before, uint64_t largest)
{
    char path[64];
    uint64_t ring = PROXIMITY_MAILBOX_MIN_RING;
    int outcome;

    while (ring < PROXIMITY_MAILBOX_MAX_RING && ring < 2 * proximity_mailbox_room_for(largest))
        ring *= 2;
    outcome = proximity_mailbox_new_file(box, ring);
    if (outcome != PROXIMITY_MAILBOX_OK)
        return outcome;
    if (before->header != NULL)
        unlink(box->path);
    snprintf(path, sizeof path, "/proc/self/fd/%d", box->file);
    if (linkat(AT_FDCWD, path, AT_FDCWD, box->path, AT_SYMLINK_FOLLOW) != 0) {
        outcome = errno == EEXIST ? PROXIMITY_MAILBOX_IN_USE : PROXIMITY_MAILBOX_SYSTEM;
        proximity_mailbox_close(box);
        return outcome;
    }
    proximity_mailbox_close(before);
    return outcome;
}

/* Open the mailbox of that name for writing messages of up to `largest` bytes. */
static inline int proximity_mailbox_create(proximity_mailbox *box, const char *name, uint64_t largest)
{
    proximity_mailbox dead;
    int outcome = proximity_mailbox_begin(box, name);

    if (outcome == PROXIMITY_MAILBOX_OK)
        outcome = proximity_mailbox_of_the_dead(box, &dead);
    if (outcome != PROXIMITY_MAILBOX_OK && outcome != PROXIMITY_MAILBOX_NOBODY)
        return outcome;
    outcome = proximity_mailbox_replace(box, &dead, largest);
    proximity_mailbox_close(&dead);
    return outcome;
}

/* Replace a mailbox by one for longer messages; if that fails, the old one stays. */
static inline int proximity_mailbox_enlarge(proximity_mailbox *box, uint64_t largest)
{
    proximity_mailbox before = *box;
    int outcome = proximity_mailbox_replace(box, &before, largest);

    if (outcome != PROXIMITY_MAILBOX_OK)
        *box = before;
    return outcome;
}
#endif

/* Write a message without waking readers; return whether it fits into the ring. Never waits. */
static inline int proximity_mailbox_add(proximity_mailbox *box, const void *message, uint32_t size)
{
    proximity_mailbox_header *header = box->header;
    uint64_t head = header->head, floor = header->floor, room = proximity_mailbox_room_for(size);
    uint32_t before;

    if (room > box->ring)
        return 0;
    while (floor + box->ring < head + room) {
        proximity_mailbox_take(box, floor, &before, sizeof before);
        floor += proximity_mailbox_room_for(before);
    }
    __atomic_store_n(&header->floor, floor, __ATOMIC_RELAXED);
    __atomic_thread_fence(__ATOMIC_SEQ_CST);
    proximity_mailbox_put(box, head, &size, sizeof size);
    proximity_mailbox_put(box, head + 16, message, size);
    header->written_ns = proximity_mailbox_now_ns();
    __atomic_store_n(&header->newest, head, __ATOMIC_RELEASE);
    __atomic_store_n(&header->head, head + room, __ATOMIC_RELEASE);
    return 1;
}

/* Write a message and wake waiting readers; return whether it fits into the ring. */
static inline int proximity_mailbox_write(proximity_mailbox *box, const void *message, uint32_t size)
{
    if (!proximity_mailbox_add(box, message, size))
        return 0;
    proximity_mailbox_wake(box);
    return 1;
}

#endif
