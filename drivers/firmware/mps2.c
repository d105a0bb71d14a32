#include "mps2.h"

#include "axt_board.h"
#include "cortex_m.h"

/* What is on the other end of an emulated UART is a socket. */
const bool axt_board_in_lumps = true;

static cmsdk_uart can_wired;
static cmsdk_uart modbus_wired;

void mps2_can_receive(void) {
    cmsdk_uart_receive(&can_wired);
}

void mps2_can_send(void) {
    cmsdk_uart_send(&can_wired);
}

void mps2_modbus_receive(void) {
    cmsdk_uart_receive(&modbus_wired);
}

void mps2_modbus_send(void) {
    cmsdk_uart_send(&modbus_wired);
}

void axt_board_start(axt_uart *can, axt_uart *modbus, uint32_t control_period) {
    const mps2_board *board = &mps2_here;
    const uint32_t first = board->first_interrupt;
    can_wired = (cmsdk_uart){
        .registers = board->can, .receive_interrupt = first, .send_interrupt = first + 1};
    modbus_wired = (cmsdk_uart){
        .registers = board->modbus, .receive_interrupt = first + 2, .send_interrupt = first + 3};
    cmsdk_uart_start(&can_wired, can, board->clock, AXT_BOARD_CAN_BIT_RATE);
    cmsdk_uart_start(&modbus_wired, modbus, board->clock, AXT_BOARD_MODBUS_BIT_RATE);
    cmsdk_watchdog_start(board->watchdog, board->clock / 1000 * AXT_BOARD_WATCHDOG_MS);
    cortex_m_start_control(board->clock, control_period);
}

void axt_board_feed_watchdog(void) {
    cmsdk_watchdog_feed(mps2_here.watchdog);
}
