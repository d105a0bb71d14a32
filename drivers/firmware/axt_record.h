/* axt_record.h - what outlives a restart, in memory that the start-up leaves alone.
 *
 * Why the last run ended, for the next one to tell; and how the host has set the SLCAN adapter,
 * which is a device of its own to it and does not fall silent when the drive starts anew.
 */
#ifndef AXT_RECORD_H
#define AXT_RECORD_H

#include <stdint.h>

#include "axt_slcan.h"

/* What an exception has left behind; the registers as the Armv7-M manual names them. */
typedef struct {
    uint16_t error_code; /* ErrorCode of the contract, 0: nothing went wrong */
    uint32_t pc;         /* the instruction that was interrupted */
    uint32_t lr;
    uint32_t psr;
    uint32_t cfsr; /* why: configurable faults, */
    uint32_t hfsr; /* hard fault, */
    uint32_t bfar; /* address of a bus fault */
} axt_fault;

/* As the host has set it. */
typedef struct {
    axt_slcan_channel channel;
    bool timestamps;
    uint32_t acceptance_code;
    uint32_t acceptance_mask;
} axt_adapter;

typedef struct {
    axt_fault fault;
    axt_adapter adapter;
    uint32_t restarts; /* since the power came on */
    uint32_t checksum; /* of all before */
} axt_record;

/* At the start: `record` as the last run left it, or cleared when the power has been off, which its
 * checksum tells. Counts the restart. */
void axt_record_begin(axt_record *record);

/* Hands over the fault that ended the last run, and forgets it. */
axt_fault axt_record_take_fault(axt_record *record);

/* For the next run. */
void axt_record_keep_fault(axt_record *record, const axt_fault *fault);

/* Keeps the adapter's settings when they are others than before. */
void axt_record_keep_adapter(axt_record *record, const axt_slcan *slcan);

/* Sets the adapter as it was. */
void axt_record_restore_adapter(const axt_record *record, axt_slcan *slcan);

#endif
