/* cmsdk.h - UART and watchdog of Arm's Cortex-M System Design Kit, which all MPS2 boards have. */
#ifndef CMSDK_H
#define CMSDK_H

#include "axt_uart.h"

typedef struct {
    volatile uint32_t data;
    volatile uint32_t state;
    volatile uint32_t control;
    volatile uint32_t interrupt; /* read: which; write: clears */
    volatile uint32_t divider;
} cmsdk_uart_registers;

/* A UART and how it is wired. */
typedef struct {
    cmsdk_uart_registers *registers;
    uint32_t receive_interrupt; /* numbers */
    uint32_t send_interrupt;
    axt_uart *uart;
} cmsdk_uart;

/* On, with its interrupts, from a clock [Hz] that is 16 times as fast as the bits or more. */
void cmsdk_uart_start(cmsdk_uart *wired, axt_uart *uart, uint32_t clock, uint32_t bit_rate);

/* Its interrupts. */
void cmsdk_uart_receive(const cmsdk_uart *wired);
void cmsdk_uart_send(const cmsdk_uart *wired);

typedef struct {
    volatile uint32_t load;
    volatile uint32_t value;
    volatile uint32_t control;
    volatile uint32_t clear;
    uint32_t reserved[764];
    volatile uint32_t lock;
} cmsdk_watchdog_registers;

/* Interrupts (NMI) when it has not been fed for so many ticks of its clock, and restarts the board
 * when that goes on for as long again. */
void cmsdk_watchdog_start(cmsdk_watchdog_registers *watchdog, uint32_t ticks);
void cmsdk_watchdog_feed(cmsdk_watchdog_registers *watchdog);

#endif
