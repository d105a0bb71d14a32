#include "axt_slcan_pty.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <termios.h>
#include <unistd.h>

#include "axt_clock.h"

/* Throws away what the last host has not read: it is not for the next one. */
static void discard_unread(const axt_slcan_pty *pty) {
    const int slave = open(pty->path, O_RDWR | O_NOCTTY | O_CLOEXEC);
    if (slave >= 0) {
        (void)tcflush(slave, TCIFLUSH);
        (void)close(slave);
    }
}

static int32_t pty_read(void *context, char *bytes, uint32_t size) {
    axt_slcan_pty *pty = context;
    const ssize_t got = read(pty->master, bytes, size);
    if (got > 0) {
        pty->held = true;
        return (int32_t)got;
    }
    if (got < 0 && (errno == EAGAIN || errno == EINTR)) {
        pty->held = true;
        return 0;
    }
    if (got < 0 && errno != EIO) {
        return AXT_CAN_ERROR_IO;
    }
    if (pty->held) { /* EIO: the host has closed the terminal */
        discard_unread(pty);
        pty->held = false;
    }
    return AXT_CAN_CLOSED;
}

static int32_t pty_write(void *context, const char *bytes, uint32_t size) {
    const axt_slcan_pty *pty = context;
    const ssize_t taken = write(pty->master, bytes, size);
    if (taken >= 0) {
        return (int32_t)taken;
    }
    if (errno != EAGAIN && errno != EINTR) {
        return AXT_CAN_ERROR_IO;
    }
    /* full: because the host is slow, or because it has gone? */
    struct pollfd terminal = {.fd = pty->master};
    const bool gone = poll(&terminal, 1, 0) > 0 && (terminal.revents & POLLHUP) != 0;
    return gone ? AXT_CAN_CLOSED : 0;
}

static uint32_t pty_milliseconds(void *context) {
    (void)context;
    return (uint32_t)(axt_clock_now() / 1000000);
}

static void pty_close(axt_can *can) {
    axt_slcan_pty *pty = (axt_slcan_pty *)can;
    if (pty->alias[0] != '\0') {
        (void)unlink(pty->alias);
    }
    (void)close(pty->master);
}

/* Makes the terminal pass every byte as it is. The setting outlives this opening of it. */
static bool make_raw(const char *path) {
    const int slave = open(path, O_RDWR | O_NOCTTY | O_CLOEXEC);
    if (slave < 0) {
        return false;
    }
    struct termios settings;
    bool done = tcgetattr(slave, &settings) == 0;
    if (done) {
        cfmakeraw(&settings);
        done = tcsetattr(slave, TCSANOW, &settings) == 0;
    }
    (void)close(slave);
    return done;
}

static axt_can_status make_alias(const char *alias, const char *path) {
    struct stat found;
    if (lstat(alias, &found) == 0) {
        if (!S_ISLNK(found.st_mode)) {
            return AXT_CAN_ERROR_IN_USE;
        }
        (void)unlink(alias);
    }
    return (symlink(path, alias) == 0) ? AXT_CAN_OK : AXT_CAN_ERROR_ADDRESS;
}

axt_can_status axt_slcan_pty_open(axt_slcan_pty *pty, const char *alias) {
    memset(pty, 0, sizeof *pty);
    if (alias != NULL && strlen(alias) >= AXT_SLCAN_PTY_PATH) {
        return AXT_CAN_ERROR_ADDRESS;
    }
    pty->master = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
    if (pty->master < 0) {
        return AXT_CAN_ERROR_IO;
    }
    if (grantpt(pty->master) != 0 || unlockpt(pty->master) != 0 ||
        ptsname_r(pty->master, pty->path, sizeof pty->path) != 0 || !make_raw(pty->path)) {
        (void)close(pty->master);
        return AXT_CAN_ERROR_IO;
    }
    if (alias != NULL) {
        const axt_can_status status = make_alias(alias, pty->path);
        if (status != AXT_CAN_OK) {
            (void)close(pty->master);
            return status;
        }
        memcpy(pty->alias, alias, strlen(alias) + 1);
    }
    const axt_slcan_carrier carrier = {
        .read = pty_read, .write = pty_write, .milliseconds = pty_milliseconds, .context = pty};
    axt_slcan_link_init(&pty->link, &carrier);
    pty->link.can.close = pty_close;
    return AXT_CAN_OK;
}
