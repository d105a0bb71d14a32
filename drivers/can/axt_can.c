#include "axt_can.h"

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
