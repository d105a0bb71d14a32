#include "axt_status.h"

const char *axt_status_string(axt_status status) {
    switch (status) {
    case AXT_OK:
        return "ok";
    case AXT_ERROR_RANGE:
        return "argument out of range";
    case AXT_ERROR_NOT_FINITE:
        return "sample or argument is not finite";
    case AXT_ERROR_SIZE:
        return "buffer too small or empty";
    case AXT_ERROR_NO_DATA:
        return "not enough data to answer";
    case AXT_ERROR_REPEATED:
        return "sample is not newer than the last one";
    case AXT_ERROR_JUMP:
        return "sample jumps further than the axis can";
    }
    return "unknown status";
}
