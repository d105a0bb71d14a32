#include "cmsdk.h"

#include "cortex_m.h"

/* state */
#define OUTPUT_FULL   UINT32_C(1)
#define INPUT_FULL    UINT32_C(2)
#define INPUT_OVERRUN UINT32_C(8)

/* control: both directions on, and both interrupts */
#define UART_ON UINT32_C(0xF)

/* interrupt */
#define SENT     UINT32_C(1)
#define RECEIVED UINT32_C(2)

/* watchdog: interrupt and restart; any write clears; this number unlocks */
#define WATCHDOG_ON     UINT32_C(3)
#define WATCHDOG_UNLOCK UINT32_C(0x1ACCE551)

static void begin_to_send(axt_uart *uart) {
    const cmsdk_uart *wired = uart->port;
    cortex_m_pend_interrupt(wired->send_interrupt);
}

void cmsdk_uart_start(cmsdk_uart *wired, axt_uart *uart, uint32_t clock, uint32_t bit_rate) {
    wired->uart = uart;
    uart->port = wired;
    uart->begin_to_send = begin_to_send;
    wired->registers->divider = clock / bit_rate;
    wired->registers->control = UART_ON;
    cortex_m_enable_interrupt(wired->receive_interrupt);
    cortex_m_enable_interrupt(wired->send_interrupt);
}

/* This UART has no parity and does not look at stop bits: damage shows in what is made of the
 * bytes. */
void cmsdk_uart_receive(const cmsdk_uart *wired) {
    cmsdk_uart_registers *registers = wired->registers;
    registers->interrupt = RECEIVED;
    if ((registers->state & INPUT_FULL) == 0) {
        return;
    }
    const bool overrun = (registers->state & INPUT_OVERRUN) != 0;
    registers->state = INPUT_OVERRUN; /* cleared by writing it */
    axt_uart_take(wired->uart, (uint8_t)registers->data, overrun ? AXT_UART_OVERRUN : 0);
}

/* Comes when a byte has left and when the background has some: nobody else writes to the UART. */
void cmsdk_uart_send(const cmsdk_uart *wired) {
    cmsdk_uart_registers *registers = wired->registers;
    uint8_t byte;
    registers->interrupt = SENT;
    while ((registers->state & OUTPUT_FULL) == 0 && axt_uart_next(wired->uart, &byte)) {
        registers->data = byte;
    }
}

void cmsdk_watchdog_start(cmsdk_watchdog_registers *watchdog, uint32_t ticks) {
    watchdog->lock = WATCHDOG_UNLOCK;
    watchdog->load = ticks;
    watchdog->control = WATCHDOG_ON;
}

void cmsdk_watchdog_feed(cmsdk_watchdog_registers *watchdog) {
    watchdog->clear = 1;
}
