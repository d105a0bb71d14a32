/* axt_slcan_pty.h - SLCAN on a pseudo-terminal: looks like a serial CAN adapter (Linux).
 *
 * A host opens the path as it would /dev/ttyUSB0; it may close it and open it again, and so may the
 * next one.
 */
#ifndef AXT_SLCAN_PTY_H
#define AXT_SLCAN_PTY_H

#include "axt_slcan_link.h"

enum { AXT_SLCAN_PTY_PATH = 256 };

typedef struct {
    axt_slcan_link link; /* use link.can */
    int master;
    bool held;                      /* a host has the terminal open */
    char path[AXT_SLCAN_PTY_PATH];  /* of the terminal, such as /dev/pts/5 */
    char alias[AXT_SLCAN_PTY_PATH]; /* symbolic link to it, or empty */
} axt_slcan_pty;

/* Opens a pseudo-terminal in raw mode. `alias` is the path of a symbolic link to make to it, which
 * replaces a symbolic link that is there but nothing else; NULL for none.
 * AXT_CAN_ERROR_IN_USE: something else is at that path; AXT_CAN_ERROR_ADDRESS: no link can be made
 * there; AXT_CAN_ERROR_IO: no pseudo-terminal to be had. Nothing is left open then. */
axt_can_status axt_slcan_pty_open(axt_slcan_pty *pty, const char *alias);

#endif
