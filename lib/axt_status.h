/* axt_status.h - what a function of the library answers. */
#ifndef AXT_STATUS_H
#define AXT_STATUS_H

/* Zero is fine, negative is an error; after an error the object that was to change is as it was. */
typedef enum {
    AXT_OK = 0,
    AXT_ERROR_RANGE = -1,      /* an argument lies outside its documented range */
    AXT_ERROR_NOT_FINITE = -2, /* a sample is infinite or not a number */
    AXT_ERROR_SIZE = -3,       /* a buffer or a table does not fit what was asked */
    AXT_ERROR_NO_DATA = -4,    /* not enough excitation or samples to answer yet */
    AXT_ERROR_REPEATED = -5,   /* a sample that is not newer than the last one taken */
    AXT_ERROR_JUMP = -6        /* a sample that the axis cannot have reached from the last ones */
} axt_status;

/* One English line for a status, in static memory; "unknown status" for any other number. */
const char *axt_status_string(axt_status status);

#endif
