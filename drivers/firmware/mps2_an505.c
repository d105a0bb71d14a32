/* MPS2 with the image AN505 (Cortex-M33). The firmware stays in the secure state that the processor
 * starts in, and sees memory and peripherals at their secure addresses. */
#include "cortex_m.h"
#include "mps2.h"

enum { VECTORS = 16, FIRST = 32 };

__attribute__((section(".vectors"),
               used)) static const cortex_m_vector vectors[VECTORS + FIRST + 4] = {
    CORTEX_M_VECTORS,
    [VECTORS + FIRST + 0] = {.handler = mps2_can_receive},
    [VECTORS + FIRST + 1] = {.handler = mps2_can_send},
    [VECTORS + FIRST + 2] = {.handler = mps2_modbus_receive},
    [VECTORS + FIRST + 3] = {.handler = mps2_modbus_send},
};

const mps2_board mps2_here = {
    .clock = 20000000,
    .can = (cmsdk_uart_registers *)0x50200000,
    .modbus = (cmsdk_uart_registers *)0x50201000,
    .first_interrupt = FIRST,
    .watchdog = (cmsdk_watchdog_registers *)0x50081000,
};
