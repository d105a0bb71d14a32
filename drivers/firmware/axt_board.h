/* axt_board.h - what the firmware asks of the board that it runs on: the processor, two UARTs, one
 * timer and a watchdog. Each board has a small source of its own and a linker script.
 */
#ifndef AXT_BOARD_H
#define AXT_BOARD_H

#include <stdbool.h>
#include <stdint.h>

#include "axt_record.h"
#include "axt_settings.h"
#include "axt_uart.h"

enum {
    AXT_BOARD_CAN_BIT_RATE = 1000000, /* of SLCAN's UART: 1 kHz of live stream takes half of it */
    AXT_BOARD_MODBUS_BIT_RATE = 115200
};

/* Are the bytes of a Modbus request handed over in lumps, as from an emulator's socket or USB? */
extern const bool axt_board_in_lumps;

/* UARTs and watchdog on, interrupts of the UARTs below that of the timer, which comes every
 * `control_period` [us] from now on and calls axt_control_interrupt(). */
void axt_board_start(axt_uart *can, axt_uart *modbus, uint32_t control_period);

/* Offered by main.c. */
void axt_control_interrupt(void);

/* The control interrupt has not been ready before the next one was due, so many times. */
uint32_t axt_board_late(void);

/* Longest control interrupt so far, as a share of its period [per mille]. */
uint32_t axt_board_load(void);

/* Time since the start [us], modulo 2^32. Not for the control interrupt. */
uint32_t axt_board_microseconds(void);

/* All is well; to be said every AXT_BOARD_WATCHDOG_MS at least, or the watchdog restarts. */
void axt_board_feed_watchdog(void);
enum { AXT_BOARD_WATCHDOG_MS = 100 };

/* Stack, and the most of it that has been used since the start [bytes]. */
uint32_t axt_board_stack_size(void);
uint32_t axt_board_stack_used(void);

/* Memory that a restart does not touch. */
axt_record *axt_board_record(void);

/* The page of settings. */
const axt_settings *axt_board_settings(void);

/* Starts anew. */
_Noreturn void axt_board_restart(void);

#endif
