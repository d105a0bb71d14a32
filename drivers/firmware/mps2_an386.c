/* MPS2 with one of the images AN385 (Cortex-M3), AN386 (Cortex-M4) and AN500 (Cortex-M7), which
 * differ in nothing but the processor. */
#include "cortex_m.h"
#include "mps2.h"

enum { VECTORS = 16 };

__attribute__((section(".vectors"), used)) static const cortex_m_vector vectors[VECTORS + 4] = {
    CORTEX_M_VECTORS,
    [VECTORS + 0] = {.handler = mps2_can_receive},
    [VECTORS + 1] = {.handler = mps2_can_send},
    [VECTORS + 2] = {.handler = mps2_modbus_receive},
    [VECTORS + 3] = {.handler = mps2_modbus_send},
};

const mps2_board mps2_here = {
    .clock = 25000000,
    .can = (cmsdk_uart_registers *)0x40004000,
    .modbus = (cmsdk_uart_registers *)0x40005000,
    .first_interrupt = 0,
    .watchdog = (cmsdk_watchdog_registers *)0x40008000,
};
