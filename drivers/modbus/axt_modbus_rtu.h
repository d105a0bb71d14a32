/* axt_modbus_rtu.h - a Modbus RTU server for a microcontroller: bytes in, bytes out.
 *
 *     void UART_IRQHandler(void) {                       main loop:
 *         axt_modbus_rtu_receive(&rtu, UART->DATA, now());   length = axt_modbus_rtu_poll(&rtu,
 * now(), } answer); send answer[0 .. length - 1]
 *
 * No heap, no operating system; the caller gives the time, in microseconds modulo 2^32.
 */
#ifndef AXT_MODBUS_RTU_H
#define AXT_MODBUS_RTU_H

#include "axt_modbus_line.h"
#include "axt_registers.h"

enum { AXT_MODBUS_BROADCAST = 0, AXT_MODBUS_UNIT_MAX = 247 };

/* Its fields are its own business. */
typedef struct {
    axt_modbus_line line;
    axt_registers_port port;
    axt_registers_client client;
    uint8_t unit;
    uint16_t registers[AXT_REGISTER_END];
} axt_modbus_rtu;

/* A server of the registers behind `port` as unit 1 .. AXT_MODBUS_UNIT_MAX. `bit_rate` and `eager`
 * as in axt_modbus_line_init(); a microcontroller is not eager. */
void axt_modbus_rtu_init(axt_modbus_rtu *rtu, const axt_registers_port *port, uint8_t unit,
                         uint32_t bit_rate, bool eager);

/* The UART's interrupt: a byte has come. Bytes that the UART marks as damaged need not be given. */
void axt_modbus_rtu_receive(axt_modbus_rtu *rtu, uint8_t byte, uint32_t now);

/* The main loop, every millisecond or two: carries out the request that has come, if any, and
 * returns the length of its answer; 0 when there is nothing to send. Frames for other units and
 * broken ones are passed over. Cost: one snapshot or one command, and about 20 operations a byte.
 */
uint32_t axt_modbus_rtu_poll(axt_modbus_rtu *rtu, uint32_t now,
                             uint8_t answer[AXT_MODBUS_LINE_FRAME_MAX]);

#endif
