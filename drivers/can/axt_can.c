#include "axt_can.h"

#define STANDARD_MAX UINT32_C(0x7FF)
#define EXTENDED_MAX UINT32_C(0x1FFFFFFF)

static const uint8_t fd_lengths[] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64};

uint8_t axt_can_fd_length(uint8_t code) {
    return fd_lengths[code & 0xF];
}

uint8_t axt_can_fd_code(uint8_t length) {
    uint8_t code = 0;
    while (code < 15 && fd_lengths[code] < length) {
        code++;
    }
    return code;
}

bool axt_can_frame_valid(const axt_can_frame *frame, bool fd) {
    const bool extended = (frame->id & AXT_CAN_EXTENDED) != 0;
    const bool remote = (frame->id & AXT_CAN_REMOTE) != 0;
    const uint32_t id = frame->id & ~(AXT_CAN_EXTENDED | AXT_CAN_REMOTE);
    if (id > (extended ? EXTENDED_MAX : STANDARD_MAX)) {
        return false;
    }
    if (!frame->fd) {
        return frame->length <= AXT_CAN_CLASSICAL_MAX;
    }
    return fd && !remote && axt_can_fd_length(axt_can_fd_code(frame->length)) == frame->length;
}

const char *axt_can_status_string(axt_can_status status) {
    switch (status) {
    case AXT_CAN_OK:
        return "fine";
    case AXT_CAN_WOULD_BLOCK:
        return "nothing to receive, or no room to send";
    case AXT_CAN_CLOSED:
        return "nobody has opened the channel";
    case AXT_CAN_ERROR_FRAME:
        return "not a frame that this bus can carry";
    case AXT_CAN_ERROR_IO:
        return "input or output failed";
    case AXT_CAN_ERROR_NO_SUPPORT:
        return "this kernel has no SocketCAN: try modprobe can_raw, or use pty or tcp";
    case AXT_CAN_ERROR_NO_INTERFACE:
        return "no such CAN interface: for a virtual one, ip link add dev vcan0 type vcan";
    case AXT_CAN_ERROR_DOWN:
        return "the CAN interface is down: ip link set NAME up";
    case AXT_CAN_ERROR_ADDRESS:
        return "not an address or path that can be used";
    case AXT_CAN_ERROR_IN_USE:
        return "the address or path is in use already";
    case AXT_CAN_ERROR_PERMISSION:
        return "not allowed";
    }
    return "unknown status";
}

const char *axt_can_state_string(axt_can_state state) {
    switch (state) {
    case AXT_CAN_STATE_ACTIVE:
        return "error active";
    case AXT_CAN_STATE_WARNING:
        return "error warning";
    case AXT_CAN_STATE_PASSIVE:
        return "error passive";
    case AXT_CAN_STATE_BUS_OFF:
        return "bus off";
    case AXT_CAN_STATE_DOWN:
        return "down";
    }
    return "unknown state";
}
