/* axt_cia402.h - the state machine of a drive after CiA 402 (IEC 61800-7-201). */
#ifndef AXT_CIA402_H
#define AXT_CIA402_H

#include <stdbool.h>
#include <stdint.h>

#include "axt_contract.h"

enum { AXT_CIA402_STATE_MASK = 0x6F }; /* bits of the status word that are the state */

/* States, as these bits. */
typedef enum {
    AXT_CIA402_NOT_READY = AXT_CONTRACT_DRIVE_STATE_NOT_READY_TO_SWITCH_ON,
    AXT_CIA402_SWITCH_ON_DISABLED = AXT_CONTRACT_DRIVE_STATE_SWITCH_ON_DISABLED,
    AXT_CIA402_READY = AXT_CONTRACT_DRIVE_STATE_READY_TO_SWITCH_ON,
    AXT_CIA402_SWITCHED_ON = AXT_CONTRACT_DRIVE_STATE_SWITCHED_ON,
    AXT_CIA402_OPERATION_ENABLED = AXT_CONTRACT_DRIVE_STATE_OPERATION_ENABLED,
    AXT_CIA402_QUICK_STOP_ACTIVE = AXT_CONTRACT_DRIVE_STATE_QUICK_STOP_ACTIVE,
    AXT_CIA402_FAULT_REACTION_ACTIVE = AXT_CONTRACT_DRIVE_STATE_FAULT_REACTION_ACTIVE,
    AXT_CIA402_FAULT = AXT_CONTRACT_DRIVE_STATE_FAULT
} axt_cia402_state;

/* Where control word `word` leads from `state` when `before` was the one before: true and the next
 * state, which is the same one where the word asks for what is already so. False when it asks for
 * something that cannot be from there; `next` is then unchanged. Transitions 2 to 12, 15 and 16;
 * the others are the drive's own. */
bool axt_cia402_next(axt_cia402_state state, uint16_t before, uint16_t word,
                     axt_cia402_state *next);

#endif
