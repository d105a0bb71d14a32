/* mps2.h - what Arm's MPS2 boards differ in: addresses, interrupts and clock. Each is a constant
 * of a source of its own with a vector table. */
#ifndef MPS2_H
#define MPS2_H

#include "cmsdk.h"

typedef struct {
    uint32_t clock; /* of processor, UARTs and watchdog [Hz] */
    cmsdk_uart_registers *can;
    cmsdk_uart_registers *modbus;
    uint32_t first_interrupt; /* receive and send of UART 0, then of UART 1 */
    cmsdk_watchdog_registers *watchdog;
} mps2_board;

/* The board at hand. */
extern const mps2_board mps2_here;

/* For its vector table. */
void mps2_can_receive(void);
void mps2_can_send(void);
void mps2_modbus_receive(void);
void mps2_modbus_send(void);

#endif
